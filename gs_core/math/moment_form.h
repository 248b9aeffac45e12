// SPDX-License-Identifier: Apache-2.0
// Stage 8: how Adam's moments are kept (optimizer.moments).
#pragma once

namespace gs {

/// As floats, or both as one code of 16 bits (tiny_code.h).
enum class MomentForm { floats, tiny };

/// Bytes of both moments of one parameter.
constexpr int moment_bytes(MomentForm form) { return form == MomentForm::floats ? 8 : 2; }

}  // namespace gs
