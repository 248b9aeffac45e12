// SPDX-License-Identifier: Apache-2.0
// Stage 8: how Adam's moments are stored (optimizer.moments).
#pragma once

namespace gs {

/// FloatMoments or HalfMoments (adam_moments.h).
enum class MomentStorage { floats, halves };

/// Bytes of both moments of one parameter.
constexpr int moment_bytes(MomentStorage storage) {
  return storage == MomentStorage::floats ? 8 : 2;
}

}  // namespace gs
