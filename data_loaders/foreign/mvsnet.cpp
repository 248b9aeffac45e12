// SPDX-License-Identifier: Apache-2.0
// cams/NAME_cam.txt of MVSNet and its successors: "extrinsic" with the four rows from world to
// camera, and "intrinsic" with three rows.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <sstream>

#include "data_loaders/foreign/foreign_model.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

constexpr std::string_view kCamEnd = "_cam.txt";

/// The numbers behind a word.
std::vector<double> numbers_behind(const ForeignModel& model, const std::filesystem::path& file,
                                   const std::string& text, const char* word, std::size_t count) {
  std::istringstream words(text.substr(std::min(text.find(word), text.size())));
  std::vector<double> numbers;
  std::string next;
  words >> next;
  for (double value = 0; numbers.size() < count && words >> next && parse_number(next, value);)
    numbers.push_back(value);
  if (numbers.size() < count)
    model.fail(fmt::format("{} has not {} numbers behind '{}'; write it again",
                           file.filename().string(), count, word));
  return numbers;
}

}  // namespace

void read_mvsnet(ForeignModel& model) {
  std::vector<std::filesystem::path> files = entries_of(model.file().parent_path());
  std::sort(files.begin(), files.end());
  for (const auto& path : files) {
    std::string label = path.filename().string();
    if (!label.ends_with(kCamEnd)) continue;
    label.resize(label.size() - kCamEnd.size());
    const auto photo = model.photo(label);
    if (!photo) continue;
    const std::string text = read_text_file(path, 1 << 16);
    const auto E = numbers_behind(model, path, text, "extrinsic", 16);
    const auto K = numbers_behind(model, path, text, "intrinsic", 9);
    const std::uint32_t camera = model.camera(model.size_of(*photo), {K[0], K[4], K[2], K[5]});
    model.add(*photo, camera, {{E[0], E[1], E[2]}, {E[4], E[5], E[6]}, {E[8], E[9], E[10]}},
              {E[3], E[7], E[11]});
  }
}

}  // namespace gs
