// SPDX-License-Identifier: Apache-2.0
// Raw data of Polycam: a JSON file for each photo, with its pose in the axes of ARKit. Photos and
// their depth maps have the same names, in folders beside that of the cameras.
#include <algorithm>
#include <optional>

#include "data_loaders/foreign/foreign_model.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

/// The photo of a camera: undistorted for corrected cameras, where there is such a photo.
std::optional<std::string> photo_of_polycam(ForeignModel& model, const std::string& name) {
  const bool is_corrected = model.file().parent_path().filename() == "corrected_cameras";
  if (is_corrected)
    if (auto photo = model.photo_at("corrected_images/" + name)) return photo;
  if (auto photo = model.photo_at("images/" + name)) return photo;
  return model.photo(name);
}

}  // namespace

void read_polycam(ForeignModel& model) {
  std::vector<std::filesystem::path> files = entries_of(model.file().parent_path());
  std::sort(files.begin(), files.end());
  const ForeignJson json(model);
  for (const auto& path : files) {
    if (path.extension() != ".json") continue;
    const auto photo = photo_of_polycam(model, path.stem().string());
    if (!photo) continue;
    const auto frame = read_json_as<SortedJson>(path, "export the raw data again");
    const auto at = [&](const char* key) { return json.number_at(frame, key); };
    const std::uint32_t camera = model.camera(json.size_at(frame, "width", "height"),
                                              {at("fx"), at("fy"), at("cx"), at("cy")});
    model.add_at(*photo, camera,
                 {{at("t_00"), at("t_01"), at("t_02")},
                  {at("t_10"), at("t_11"), at("t_12")},
                  {at("t_20"), at("t_21"), at("t_22")}},
                 {at("t_03"), at("t_13"), at("t_23")}, true);
  }
}

}  // namespace gs
