// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/cameras/exposure_file.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

// float as the number type: written with the digits that a float needs.
using Json = nlohmann::basic_json<std::map, std::vector, std::string, bool, std::int64_t,
                                  std::uint64_t, float>;

constexpr const char* kRemedy = "train again, or remove the file to compute exposures again";

Vec3f exposure_of(const Json& json, const std::string& name, const std::filesystem::path& path) {
  Vec3f exposure(0);
  const bool has_three = json.is_array() && json.size() == 3;
  for (int c = 0; has_three && c < 3; ++c)
    if (json[std::size_t(c)].is_number()) exposure[c] = json[std::size_t(c)].get<float>();
  if (!(exposure.x > 0 && exposure.y > 0 && exposure.z > 0 && is_finite(exposure)))
    cannot_read(path, fmt::format("the exposure of '{}' is not three numbers above 0; {}",
                                  shown_word(name), kRemedy));
  return exposure;
}

}  // namespace

void write_exposures(const std::filesystem::path& path, const Scene& scene) {
  Json json = Json::object();
  for (const auto* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views)
      json[view.name] = {view.exposure.x, view.exposure.y, view.exposure.z};
  std::string text = "{";
  for (const auto& [name, exposure] : json.items())
    text += fmt::format("{}\n{}: {}", text.size() > 1 ? "," : "",
                        Json(name).dump(-1, ' ', false, Json::error_handler_t::replace),
                        exposure.dump());
  AtomicFile file(path);
  file.write(text + "\n}\n");
  file.commit();
}

Exposures read_exposures(const std::filesystem::path& path) {
  const auto json = read_json_as<Json>(path, kRemedy);
  if (!json.is_object()) cannot_read(path, fmt::format("it is not a list of photos; {}", kRemedy));
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
