// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/edit_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <set>

#include "gs_core/bake_filter.h"
#include "gs_core/error.h"
#include "gs_core/evenly_chosen.h"
#include "gs_core/geometry/scene_frame.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/geometry/world_offset.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_model/edit/model_moment.h"
#include "gs_model/edit/upright.h"
#include "gs_model/formats/coding/finite_rows.h"

namespace gs {
namespace {

constexpr double kMostLost = 1e-4;               // of the spread, as for scenes (world_offset.h)
constexpr std::size_t kMostPositions = 100'000;  // that decide about a world offset
constexpr double kFloorRadius = 2;  // of the cameras' distance from the middle: what is their scene

Vec3d transformed(const Mat4d& matrix, const Vec3d& p) {
  const auto row = [&](int i) {
    return matrix.m[i][0] * p.x + matrix.m[i][1] * p.y + matrix.m[i][2] * p.z + matrix.m[i][3];
  };
  return {row(0), row(1), row(2)};
}

}  // namespace

Mat4d input_from(const EditModel& model) {
  return model.input_from_model.value_or(translation(model.model.world_offset));
}

void keep_rows(EditModel& model, const std::vector<std::uint32_t>& rows) {
  if (rows.size() < model.model.gaussians.count()) model.model = rows_of(model.model, rows);
}

ModelTransform transform_about(const Vec3d& center, const Quat<double>& turn, double scale) {
  const Vec3d back = multiply_transposed(rotation_matrix(turn), center) / scale;
  return {center - back, turn, scale};
}

Quat<double> turn_by_degrees(const Vec3d& degrees) {
  const auto about = [](int axis, double angle) {
    Quat<double> q{std::cos(angle * std::numbers::pi / 360), 0, 0, 0};
    (axis == 0 ? q.x : axis == 1 ? q.y : q.z) = std::sin(angle * std::numbers::pi / 360);
    return q;
  };
  return product(about(2, degrees.z), product(about(1, degrees.y), about(0, degrees.x)));
}

void transform_edited(EditModel& model, const ModelTransform& transform) {
  if (transform.is_identity()) return;
  const Vec3d before = model.model.world_offset;
  const Mat4d after_from_model = multiply(matrix_of(transform), translation(before));
  const Vec3d after = offset_of_positions(positions_under(after_from_model, model.model.gaussians));
  const Vec3d shift = multiply_transposed(rotation_matrix(transform.turn), after) / transform.scale;
  const ModelTransform of_numbers{transform.center - before + shift, transform.turn,
                                  transform.scale};
  const Mat4d input_from_before = input_from(model);
  transform_numbers(model, of_numbers);
  model.model.world_offset = after;
  model.input_from_model = multiply(input_from_before, inverse_of(matrix_of(of_numbers)));
}

void move_cameras(std::vector<EditCamera>& cameras, const ModelTransform& transform) {
  if (transform.is_identity()) return;
  for (EditCamera& camera : cameras) camera.camera = moved(camera.camera, transform);
}

void transform_numbers(EditModel& model, const ModelTransform& transform) {
  transform_model(model.model, transform);
  move_cameras(model.cameras, transform);
  if (model.input_from_model)
    model.input_from_model = multiply(*model.input_from_model, inverse_of(matrix_of(transform)));
}

std::vector<Vec3d> positions_under(const Mat4d& matrix, const Gaussians& gaussians) {
  std::vector<Vec3d> positions;
  for (const std::size_t i : evenly_chosen(gaussians.count(), kMostPositions))
    if (is_finite(gaussians.mean[i]))
      positions.push_back(transformed(matrix, Vec3d(gaussians.mean[i])));
  return positions;
}

Vec3d offset_of_positions(const std::vector<Vec3d>& positions) {
  return world_offset_of(positions, kMostLost);
}

double scale_of(const EditModel& model) {
  const Mat4d matrix = input_from(model);
  return 1 / length(Vec3d{matrix.m[0][0], matrix.m[0][1], matrix.m[0][2]});
}

Straightened straighten(EditModel& model) {
  std::optional<Gaussians> storage;
  const Gaussians& gaussians = drawn_gaussians(model.model, storage);
  std::vector<Camera> cameras;
  for (const EditCamera& camera : model.cameras) cameras.push_back(camera.camera);
  SceneFrame frame = scene_frame(cameras, gaussians.mean.span());
  Straightened result;
  result.by_cameras = !cameras.empty();
  if (result.by_cameras && !frame.up_is_known)
    throw UsageError(
        "cannot straighten the model: its cameras are held in all directions or lie on their side, "
        "so they do not say which way is up; give that direction with --up X,Y,Z");
  double radius = kFloorRadius * frame.radius;
  if (!result.by_cameras) {
    frame.up = up_of_levels(gaussians);
    radius = frame.radius;
  }
  const double height = floor_height(gaussians, frame.up, frame.center, radius);
  result.degrees = std::acos(std::clamp(-frame.up.y, -1.0, 1.0)) * 180 / std::numbers::pi;
  result.raised = -height;
  const Vec3d floor = frame.center + height * frame.up + model.model.world_offset;
  transform_edited(model, {floor, turn_upright(frame.up), 1});
  return result;
}

void restore_frame(EditModel& model) {
  if (!model.input_from_model) return;
  const Mat4d numbers_from_now = translation(-model.model.world_offset);
  transform_edited(model, transform_of(multiply(*model.input_from_model, numbers_from_now)));
  model.input_from_model.reset();
}

GaussianModel in_photos_frame(const EditModel& model) {
  std::vector<std::uint32_t> all(model.model.gaussians.count());
  std::iota(all.begin(), all.end(), 0u);
  EditModel copy{rows_of(model.model, all), model.input_from_model, {}};
  restore_frame(copy);
  return std::move(copy.model);
}

void decimate_by_merging(EditModel& model, std::size_t count, const DecimateOptions& options) {
  if (!model.model.gaussians.has_time && model.model.gaussians.count() <= count) return;
  decimate(model.model.gaussians, count, options);
}

const Gaussians& drawn_gaussians(const GaussianModel& model, std::optional<Gaussians>& storage) {
  const Gaussians& gaussians = model.gaussians;
  if (!gaussians.has_time && !gaussians.has_filter) return gaussians;
  storage = gaussians.has_time ? middles_of_lives(gaussians) : copy_of(gaussians);
  bake_filter(*storage);
  return *storage;
}

}  // namespace gs
