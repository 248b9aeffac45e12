// SPDX-License-Identifier: Apache-2.0
// What the output of COLMAP's programs says: how far a stage is, and what became of each photo. Written for
// the lines of COLMAP 3.8, which later versions keep behind a prefix of their log; a line that says
// nothing of this is passed over, so that another version costs detail and never the result.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// So many of a stage's units are done.
struct ColmapCount {
  std::int64_t done = 0, total = 0;  // total 0: not said in the line
};

/// "Processed file [3/12]", "Matching block [1/4, 2/4]", "Matching image [5/300]", "Registering image #7 (4)".
std::optional<ColmapCount> colmap_count(std::string_view line);

/// What became of the photos, from the whole log. Ids are COLMAP's: 1, 2, ... in the order in which
/// features were stored, which the reader of the model checks.
struct ColmapLog {
  struct Photo {
    std::string name;
    int features = 0;
  };
  std::vector<Photo> photos;                 // photos[i] has id i + 1
  std::map<std::uint32_t, int> seen_points;  // by id: of the model, when its pose was last tried
  bool no_model = false;                     // the mapper's last word: nothing could be placed
};

ColmapLog read_colmap_log(const std::filesystem::path& file);

/// The last lines of a file that are not empty, for a message.
std::string last_lines(const std::filesystem::path& file, std::size_t count);

}  // namespace gs
