// SPDX-License-Identifier: Apache-2.0
// The message for a card that this build cannot run on.
#pragma once

#include <string>
#include <vector>

namespace gs::cuda {

/// Compute capabilities as whole numbers: 75 is 7.5, 120 is 12.0.
using Capability = int;

/// The oldest cards that the kernels are written for: Turing.
inline constexpr Capability kOldestCapability = 75;

/// Says which card it is, which capabilities the build was made for, and which command builds for
/// that card.
std::string unserved_card(const std::string& name, Capability capability,
                          const std::vector<Capability>& built_for);

}  // namespace gs::cuda
