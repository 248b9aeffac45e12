// SPDX-License-Identifier: Apache-2.0
// The section "about" of a checkpoint: numbers that people may want to read, as JSON.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "gs_app/checkpoints/checkpoint_file.h"

namespace gs {

inline constexpr std::int64_t kMostSteps = 2'000'000'000;  // as int, with some left to count on

std::string about_text(const RunProgress& progress, const TrainingModel& model,
                       const SceneRecord& scene);

/// Takes what is written there; `checkpoint` has its views already. Throws Error for a number that
/// is out of its range: the right checksum does not prove that this program wrote the file.
void take_about(const std::filesystem::path& path, const std::string& text, Checkpoint& checkpoint);

}  // namespace gs
