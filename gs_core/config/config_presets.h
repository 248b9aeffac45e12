// SPDX-License-Identifier: Apache-2.0
// The files of configs/. CMake writes them into config_presets.cpp, so that the program finds a
// preset by its name wherever it is installed.
#pragma once

#include <string_view>
#include <vector>

namespace gs {

/// One file of configs/: its name without .toml, and its text.
struct Preset {
  std::string_view name, text;
};

/// All presets, by name.
const std::vector<Preset>& presets();

/// The purpose of a preset: the first line of its text, a comment.
inline std::string_view summary(const Preset& preset) {
  constexpr std::string_view kComment = "# ";
  const std::string_view line = preset.text.substr(0, preset.text.find('\n'));
  return line.starts_with(kComment) ? line.substr(kComment.size()) : line;
}

}  // namespace gs
