// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/scene_looks.h"

#include "gs_train/photometric/photometric_start.h"

namespace gs {
namespace {

std::vector<float> copied(Span<const float> numbers) { return {numbers.begin(), numbers.end()}; }

CameraLook camera_look(const View& view, Span<const float> numbers) {
  const Camera& camera = view.camera;
  return {camera.width, camera.height, camera.cx, camera.cy, copied(numbers)};
}

}  // namespace

SceneLooks looks_of(const PhotometricConfig& config, const PhotometricState& in_any_memory,
                    const Scene& scene) {
  const PhotometricState state = copy_to(host_memory(), in_any_memory);
  const std::vector<std::uint32_t> camera_of = camera_rows(scene.train_views);
  SceneLooks looks;
  looks.config = config;
  for (std::size_t i = 0; i < scene.train_views.size(); ++i) {
    const View& view = scene.train_views[i];
    looks.photos[view.name] = {view.camera_id, false, copied(state.photo(i))};
    looks.cameras.try_emplace(view.camera_id, camera_look(view, state.camera(camera_of[i])));
  }
  HeldOutPhotos held_out = foretell_held_out(state, scene);
  for (std::size_t i = 0; i < scene.test_views.size(); ++i) {
    const View& view = scene.test_views[i];
    looks.photos[view.name] = {view.camera_id, true, std::move(held_out.numbers[i])};
  }
  looks.rules = std::move(held_out.rules);
  looks.rule = std::move(held_out.rule);
  return looks;
}

// A camera that took no training photo has no vignetting that is known.
AppearanceOf appearances(const SceneLooks& looks) {
  const auto shared = std::make_shared<const SceneLooks>(looks);
  const std::shared_ptr<const PhotometricModel> model = make_photometric_model(looks.config);
  const std::vector<float> unknown(model->camera_names().size(), 0.0f);
  return [shared, model, unknown](const View& view) -> std::unique_ptr<Appearance> {
    const auto photo = shared->photos.find(view.name);
    if (photo == shared->photos.end()) return nullptr;
    const auto camera = shared->cameras.find(photo->second.camera_id);
    const std::vector<float>& lens =
        camera == shared->cameras.end() ? unknown : camera->second.numbers;
    const std::vector<float>& numbers = photo->second.numbers;
    const Camera& size = view.camera;
    return model->appearance({numbers.data(), numbers.size()}, {lens.data(), lens.size()},
                             lens_place(size.cx, size.cy, size.width, size.height, 1));
  };
}

}  // namespace gs
