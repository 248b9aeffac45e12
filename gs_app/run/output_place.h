// SPDX-License-Identifier: Apache-2.0
// Where a verb writes if no -o names a place: beside its input, over nothing, and said aloud.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gs {

/// The input's name without the ending of a file, and `suffix`: scene/ and film.mp4 get scene-run and
/// film-run beside them. What is relative stays so.
std::filesystem::path beside(const std::filesystem::path& input, const std::string& suffix);

/// Says that a verb writes there.
void say_place(const std::filesystem::path& place);

/// The place of a new output: `stem` with the first of `endings`, or else STEM-2, STEM-3, ..., so
/// that nothing has one of these names with any of the endings. Says it.
std::filesystem::path new_place(const std::filesystem::path& stem,
                                const std::vector<std::string>& endings = {""});

}  // namespace gs
