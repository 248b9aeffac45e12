// SPDX-License-Identifier: Apache-2.0
// CUB's way of asking for working room: a first call says how much, a second one works.
#pragma once

#include "cuda/context.cuh"
#include "gs_core/buffer.h"

namespace gs::cuda {

/// Calls algorithm(temporary, bytes) twice, as CUB wants it, with room that only grows.
template <class Algorithm>
void with_cub_room(Buffer<std::uint8_t>& room, const char* what, Algorithm&& algorithm) {
  std::size_t bytes = 0;
  check(algorithm(nullptr, bytes), what);
  if (bytes > room.size()) room.resize_discard(bytes);
  check(algorithm(room.data(), bytes), what);
}

}  // namespace gs::cuda
