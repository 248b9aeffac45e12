// SPDX-License-Identifier: Apache-2.0
// Scratch memory of CUB's algorithms, which are called twice: the first call tells the size, the
// second one works.
#pragma once

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"

namespace gs::cuda {

/// Calls algorithm(temporary, bytes) twice, as CUB asks for. `scratch` grows where it is too small
/// and never shrinks; `what` names the stage in errors.
template <class Algorithm>
void with_cub_scratch(Buffer<std::uint8_t>& scratch, const char* what, Algorithm&& algorithm) {
  std::size_t bytes = 0;
  check(algorithm(nullptr, bytes), what);
  if (bytes > scratch.size()) scratch.resize_discard(bytes);
  check(algorithm(scratch.data(), bytes), what);
}

}  // namespace gs::cuda
