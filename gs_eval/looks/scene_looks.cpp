// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/looks/scene_looks.h"

#include <algorithm>

#include "gs_train/photometric/photometric_start.h"

namespace gs {
namespace {

std::vector<float> copied(Span<const float> numbers) { return {numbers.begin(), numbers.end()}; }

std::vector<float> solved_numbers(const PhotometricModel& model, const View& view) {
  std::vector<float> numbers(model.photo_names().size(), 0.0f);
  model.start_from_gains(view.exposure, {numbers.data(), numbers.size()});
  return numbers;
}

// The mean of learned minus solved numbers over the training photos.
std::vector<float> common_difference(const PhotometricModel& model, const SceneLooks& looks,
                                     const Scene& scene) {
  std::vector<double> sum(model.photo_names().size(), 0.0);
  std::size_t count = 0;
  for (const View& view : scene.train_views) {
    const auto look = looks.photos.find(view.name);
    if (look == looks.photos.end() || look->second.is_held_out) continue;
    const std::vector<float> solved = solved_numbers(model, view);
    for (std::size_t k = 0; k < sum.size(); ++k)
      sum[k] += double(look->second.numbers[k]) - double(solved[k]);
    ++count;
  }
  std::vector<float> mean;
  for (const double of_all : sum)
    mean.push_back(float(of_all / double(std::max<std::size_t>(count, 1))));
  return mean;
}

}  // namespace

SceneLooks looks_of(const PhotometricConfig& config, const PhotometricState& in_any_memory,
                    const Scene& scene) {
  const PhotometricState state = copy_to(host_memory(), in_any_memory);
  SceneLooks looks;
  looks.config = config;
  for (std::size_t i = 0; i < scene.train_views.size(); ++i) {
    const View& view = scene.train_views[i];
    looks.photos[view.name] = {view.camera_id, false, copied(state.row(i))};
  }
  HeldOutPhotos held_out = predict_held_out(state, scene);
  for (std::size_t i = 0; i < scene.test_views.size(); ++i) {
    const View& view = scene.test_views[i];
    looks.photos[view.name] = {view.camera_id, true, std::move(held_out.numbers[i])};
  }
  looks.rules = std::move(held_out.rules);
  looks.rule = std::move(held_out.rule);
  return looks;
}

AppearanceOf appearances(const SceneLooks& looks) {
  const auto shared = std::make_shared<const SceneLooks>(looks);
  const std::shared_ptr<const PhotometricModel> model = make_photometric_model(looks.config);
  return [shared, model](const View& view) -> std::unique_ptr<Appearance> {
    const auto photo = shared->photos.find(view.name);
    if (photo == shared->photos.end()) return nullptr;
    const std::vector<float>& numbers = photo->second.numbers;
    return model->appearance({numbers.data(), numbers.size()});
  };
}

AppearanceOf solved_appearances(const SceneLooks& looks, const Scene& scene) {
  const auto model = make_photometric_model(looks.config);
  const std::vector<float> difference = common_difference(*model, looks, scene);
  SceneLooks solved = looks;
  for (const auto* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views) {
      const auto look = solved.photos.find(view.name);
      if (look == solved.photos.end()) continue;
      look->second.numbers = solved_numbers(*model, view);
      for (std::size_t k = 0; k < difference.size(); ++k) look->second.numbers[k] += difference[k];
    }
  return [of = appearances(solved)](const View& view) {
    return view.has_exposure() ? of(view) : nullptr;
  };
}

}  // namespace gs
