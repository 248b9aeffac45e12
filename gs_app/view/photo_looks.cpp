// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/photo_looks.h"

#include <cmath>

#include "data_loaders/photos/photo_names.h"
#include "gs_core/system/text/json.h"

namespace gs {

std::string photo_in(const SceneLooks& looks, const std::string& name) {
  if (looks.photos.contains(name)) return name;
  for (const auto& [photo, look] : looks.photos)
    if (without_extension(photo) == name) return photo;
  return {};
}

Json look_json(const SceneLooks& looks, const std::string& photo) {
  const std::vector<float>& log_gains = looks.photos.at(photo).numbers;
  Json gain = Json::array();
  for (const float log_gain : log_gains) gain.push_back(std::exp(log_gain));
  return {{"gain", std::move(gain)}};
}

}  // namespace gs
