// SPDX-License-Identifier: Apache-2.0
#include "gs_app/edit/edit_cameras.h"

#include <set>

#include "data_loaders/photos/photo_names.h"
#include "gs_app/export/cameras.h"

namespace gs {
namespace {

// Reads cameras near the model, where floats are fine, and brings them into its frame. `read` gets
// the world offset that they are to have.
template <class Read>
std::vector<EditCamera> in_frame_of(const EditModel& model, Read&& read) {
  if (!model.input_from_model) return read(model.model.world_offset);
  const Mat4d& input_from_model = *model.input_from_model;
  const Vec3d offset =
      offset_of_positions(positions_under(input_from_model, model.model.gaussians));
  std::vector<EditCamera> cameras = read(offset);
  move_cameras(cameras, transform_of(multiply(inverse_of(input_from_model), translation(offset))));
  return cameras;
}

std::vector<EditCamera> as_training(std::vector<NamedCamera> cameras) {
  std::vector<EditCamera> result;
  for (NamedCamera& camera : cameras) result.push_back({std::move(camera.name), camera.camera});
  return result;
}

}  // namespace

EditModel model_to_edit(OpenedModel opened) {
  return {std::move(opened.model), opened.input_from_model, {}};
}

std::vector<EditCamera> cameras_to_edit(const RunFolder& run, const EditModel& model) {
  return in_frame_of(model, [&](const Vec3d& offset) {
    std::vector<EditCamera> cameras = as_training(cameras_of_run(run, 1, "all", offset));
    if (!std::filesystem::exists(run.split())) return cameras;
    std::set<std::string> test;
    for (const std::string& name : split_names(run, "test")) test.insert(without_extension(name));
    for (EditCamera& camera : cameras) camera.is_test = test.contains(camera.name);
    return cameras;
  });
}

std::vector<EditCamera> cameras_to_edit(const std::filesystem::path& file, const EditModel& model) {
  return in_frame_of(
      model, [&](const Vec3d& offset) { return as_training(cameras_of_file(file, 1, offset)); });
}

std::vector<EditCamera> cameras_to_edit(const DatasetConfig& scene, const EditModel& model) {
  return in_frame_of(model, [&](const Vec3d& offset) {
    return as_training(cameras_of_scene(scene, "all", offset));
  });
}

}  // namespace gs
