// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/cameras/exposure_file.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

// float as the number type: written with the digits that a float needs.

constexpr const char* kRemedyOfExposures =
    "train again, or remove the file to compute exposures again";

Vec3f exposure_of(const SortedFloatJson& json, const std::string& name,
                  const std::filesystem::path& path) {
  Vec3f exposure(0);
  const bool has_three = json.is_array() && json.size() == 3;
  for (int c = 0; has_three && c < 3; ++c)
    if (json[std::size_t(c)].is_number()) exposure[c] = json[std::size_t(c)].get<float>();
  if (!(exposure.x > 0 && exposure.y > 0 && exposure.z > 0 && is_finite(exposure)))
    cannot_read(path, fmt::format("the exposure of '{}' is not three numbers above 0; {}",
                                  shown_word(name), kRemedyOfExposures));
  return exposure;
}

}  // namespace

void write_exposures(const std::filesystem::path& path, const Scene& scene) {
  SortedFloatJson json = SortedFloatJson::object();
  for (const auto* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views)
      json[view.name] = {view.exposure.x, view.exposure.y, view.exposure.z};
  std::string text = "{";
  for (const auto& [name, exposure] : json.items())
    text += fmt::format(
        "{}\n{}: {}", text.size() > 1 ? "," : "",
        SortedFloatJson(name).dump(-1, ' ', false, SortedFloatJson::error_handler_t::replace),
        exposure.dump());
  AtomicFile file(path);
  file.write(text + "\n}\n");
  file.commit();
}

Exposures read_exposures(const std::filesystem::path& path) {
  const auto json = read_json_as<SortedFloatJson>(path, kRemedyOfExposures);
  if (!json.is_object())
    cannot_read(path, fmt::format("it is not a list of photos; {}", kRemedyOfExposures));
  Exposures exposures;
  for (const auto& [name, value] : json.items()) exposures[name] = exposure_of(value, name, path);
  return exposures;
}

void apply_exposures(const Exposures& exposures, Scene& scene) {
  for (auto* views : {&scene.train_views, &scene.test_views})
    for (View& view : *views)
      if (const auto found = exposures.find(view.name); found != exposures.end())
        view.exposure = found->second;
}

}  // namespace gs
