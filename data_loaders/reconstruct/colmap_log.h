// SPDX-License-Identifier: Apache-2.0
// Understands what COLMAP prints: the progress of a stage, and what became of each photo. The lines
// are those of COLMAP 3.8; later versions put a prefix before them. Unknown lines are skipped, so
// that another version of COLMAP costs detail and never the result.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// The progress of a stage.
struct ColmapCount {
  std::int64_t done = 0, total = 0;  // total 0: not said in the line
};

/// The counts in "Processed file [3/12]", "Matching block [1/4, 2/4]", "Matching image [5/300]" or
/// "Registering image #7 (4)"; nothing for other lines.
std::optional<ColmapCount> colmap_count(std::string_view line);

/// The result for each photo, from the whole log. COLMAP's ids are 1, 2, ... in the order in which
/// it stored features; colmap_verdict.cpp checks that against the model.
struct ColmapLog {
  struct Photo {
    std::string name;
    int features = 0;
  };
  std::vector<Photo> photos;                 // photos[i] has id i + 1
  std::map<std::uint32_t, int> seen_points;  // by id: the model's, when its pose was last tried
  bool no_model = false;                     // the mapper could place nothing
};

ColmapLog read_colmap_log(const std::filesystem::path& file);

/// The last lines of a file that are not empty, for a message.
std::string last_lines(const std::filesystem::path& file, std::size_t count);

}  // namespace gs
