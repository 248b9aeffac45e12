// SPDX-License-Identifier: Apache-2.0
// Scratch memory of CUB's algorithms, which are called twice: the first call tells the size, the
// second one works.
#pragma once

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"

namespace gs::cuda {

/// Calls algorithm(temporary, bytes) twice, as CUB asks for. `scratch` grows where it is too small
/// and never shrinks, and what it holds is lost; `what` names the stage in errors.
template <class T, class Algorithm>
void with_cub_scratch(Buffer<T>& scratch, const char* what, Algorithm&& algorithm) {
  std::size_t bytes = 0;
  check(algorithm(nullptr, bytes), what);
  const std::size_t size = (bytes + sizeof(T) - 1) / sizeof(T);
  if (size > scratch.size()) scratch.resize_discard(size);
  check(algorithm(scratch.data(), bytes), what);
}

}  // namespace gs::cuda
