// SPDX-License-Identifier: Apache-2.0
// Stage 8: how Adam's moments are kept (optimizer.moments).
#pragma once

namespace gs {

/// As floats, as codes of 16 bits each (compact_code.h), or both as one code of 16 bits
/// (tiny_code.h).
enum class MomentForm { floats, compact, tiny };

constexpr bool are_codes(MomentForm form) { return form != MomentForm::floats; }

/// Bytes of both moments of one parameter.
constexpr int moment_bytes(MomentForm form) {
  return form == MomentForm::floats ? 8 : form == MomentForm::compact ? 4 : 2;
}

}  // namespace gs
