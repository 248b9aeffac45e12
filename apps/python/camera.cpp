// SPDX-License-Identifier: Apache-2.0
#include "apps/python/camera.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "apps/python/arrays.h"
#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/constants.h"

namespace gs::python {
namespace {

constexpr double kRotationTolerance = 1e-3;  // of R R^T - 1: single precision and rounded text

using Matrix = py::array_t<double, py::array::c_style | py::array::forcecast>;

void check_rotation(const Mat3<double>& R) {
  if (!is_rotation(R, kRotationTolerance))
    throw UsageError(
        "cam_from_world must hold a rotation (orthonormal, determinant 1) in its first three "
        "columns");
}

void set_pose(PinholeCamera<double>& camera, const py::object& pose) {
  const auto matrix = Matrix::ensure(pose);
  if (!matrix) PyErr_Clear();
  const bool fits = matrix && matrix.ndim() == 2 && matrix.shape(1) == 4 &&
                    (matrix.shape(0) == 3 || matrix.shape(0) == 4);
  if (!fits) throw UsageError("cam_from_world must be a matrix of 3 or 4 rows and 4 columns");
  if (matrix.shape(0) == 4)
    for (int j = 0; j < 4; ++j)
      if (!(std::abs(matrix.at(3, j) - (j == 3)) < kRotationTolerance))
        throw UsageError("the last row of cam_from_world must be 0 0 0 1; is it transposed?");
  const auto row = [&](int i) { return Vec3d{matrix.at(i, 0), matrix.at(i, 1), matrix.at(i, 2)}; };
  camera.cam_from_world_rotation = {row(0), row(1), row(2)};
  camera.cam_from_world_translation = {matrix.at(0, 3), matrix.at(1, 3), matrix.at(2, 3)};
  check_rotation(camera.cam_from_world_rotation);
  for (int i = 0; i < 3; ++i)
    if (!std::isfinite(camera.cam_from_world_translation[i]))
      throw UsageError("the translation of cam_from_world must be finite");
}

double checked_time(double time) {
  if (!(time >= 0 && time <= 1))
    throw UsageError(fmt::format("the time must lie between 0 and 1, but is {}", time));
  return time;
}

NamedCamera make_camera(int width, int height, double fx, std::optional<double> fy,
                        std::optional<double> cx, std::optional<double> cy, const py::object& pose,
                        const std::string& name, double time) {
  PinholeCamera<double> camera;
  camera.time = checked_time(time);
  camera.width = width;
  camera.height = height;
  camera.fx = fx;
  camera.fy = fy.value_or(fx);
  camera.cx = cx.value_or(0.5 * width);
  camera.cy = cy.value_or(0.5 * height);
  if (std::min(width, height) < 1 || std::max(width, height) > kMaxPictureSide)
    throw UsageError(
        fmt::format("width and height must lie between 1 and {} pixels, but are {} and {}",
                    kMaxPictureSide, width, height));
  if (!(camera.fx > 0 && camera.fy > 0 && std::isfinite(camera.fx) && std::isfinite(camera.fy)))
    throw UsageError("fx and fy must be above 0 and finite");
  if (!std::isfinite(camera.cx) || !std::isfinite(camera.cy))
    throw UsageError("cx and cy must be finite");
  if (!pose.is_none()) set_pose(camera, pose);
  const Camera kept = camera_as<float>(camera);
  const Vec3f at = kept.position();
  bool fits = kept.fx > 0 && kept.fy > 0;
  for (const float x : {kept.fx, kept.fy, kept.cx, kept.cy, at.x, at.y, at.z})
    fits = fits && std::isfinite(x);
  if (!fits) throw UsageError("the camera's numbers do not fit 32 bits; scale or move the scene");
  return {name, kept};
}

Matrix cam_from_world(const NamedCamera& named) {
  const Camera& camera = named.camera;
  const Vec3f rows[3] = {camera.cam_from_world_rotation.row0, camera.cam_from_world_rotation.row1,
                         camera.cam_from_world_rotation.row2};
  Matrix matrix(Shape{4, 4});
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      matrix.mutable_at(i, j) = i == 3   ? double(j == 3)
                                : j == 3 ? camera.cam_from_world_translation[i]
                                         : rows[i][j];
  return matrix;
}

py::array_t<double> position(const NamedCamera& named) {
  const Vec3f at = named.camera.position();
  py::array_t<double> array(3);
  for (int i = 0; i < 3; ++i) array.mutable_at(i) = at[i];
  return array;
}

NamedCamera at_other_time(NamedCamera named, double time) {
  named.camera.time = float(checked_time(time));
  return named;
}

NamedCamera at_other_resolution(const NamedCamera& named, int resolution) {
  if (resolution < 1) throw UsageError("the resolution must be 1 or more");
  return {named.name, at_resolution(named.camera, resolution)};
}

std::vector<NamedCamera> load_cameras(const std::filesystem::path& path,
                                      const py::object& world_offset) {
  const Vec3d offset =
      world_offset.is_none() ? Vec3d(0.0) : vector_of("world_offset", world_offset);
  const py::gil_scoped_release release;
  return read_cameras_json(path, offset);
}

}  // namespace

std::vector<NamedCamera> named_cameras_of(const py::object& cameras) {
  std::vector<NamedCamera> result;
  if (cameras.is_none()) return result;
  for (const py::handle& camera : cameras.cast<py::iterable>()) {
    if (!py::isinstance<NamedCamera>(camera)) throw UsageError("cameras must be a list of Camera");
    result.push_back(camera.cast<const NamedCamera&>());
  }
  return result;
}

void bind_camera(py::module_& module) {
  py::class_<NamedCamera> camera(
      module, "Camera",
      R"(An undistorted pinhole camera. Pixel (i, j) has its center at (i + 0.5, j + 0.5); the camera's
axes are x right, y down, z forward, as in COLMAP and OpenCV. Numbers are kept as float32.)");
  camera.def(
      py::init(&make_camera),
      R"(width, height, fx, fy, cx, cy in pixels; without fy it is fx, without cx and cy the picture's
center. cam_from_world: (3, 4) or (4, 4), a rotation and a translation in world units; without it
the camera is at the origin and looks along z. time: the moment of a scene that moves, from 0 to 1.)",
      py::arg("width"), py::arg("height"), py::arg("fx"), py::arg("fy") = py::none(),
      py::arg("cx") = py::none(), py::arg("cy") = py::none(),
      py::arg("cam_from_world") = py::none(), py::arg("name") = "", py::arg("time") = 0.0);
  camera.def_readonly("name", &NamedCamera::name, "Name of its photo, if it has one.");
  camera.def_property_readonly(
      "width", [](const NamedCamera& self) { return self.camera.width; }, "Pixels.");
  camera.def_property_readonly(
      "height", [](const NamedCamera& self) { return self.camera.height; }, "Pixels.");
  camera.def_property_readonly(
      "fx", [](const NamedCamera& self) { return self.camera.fx; }, "Pixels.");
  camera.def_property_readonly(
      "fy", [](const NamedCamera& self) { return self.camera.fy; }, "Pixels.");
  camera.def_property_readonly(
      "cx", [](const NamedCamera& self) { return self.camera.cx; }, "Pixels.");
  camera.def_property_readonly(
      "cy", [](const NamedCamera& self) { return self.camera.cy; }, "Pixels.");
  camera.def_property_readonly("cam_from_world", cam_from_world,
                               "(4, 4) float64: from world to camera coordinates. A copy.");
  camera.def_property_readonly("position", position,
                               "(3,) float64: the camera's center, world units. A copy.");
  camera.def_property_readonly(
      "time", [](const NamedCamera& self) { return self.camera.time; },
      "The moment of a scene that moves, from 0 to 1: a model that moves is rendered as it is "
      "then.");
  camera.def("at_time", at_other_time, py::arg("time"), "The same view at another moment, 0 to 1.");
  camera.def("at_resolution", at_other_resolution, py::arg("resolution"),
             "The same view in a smaller picture: 1 to 8 divides its size, a larger number is its "
             "new width in pixels.");
  camera.def("__repr__", [](const NamedCamera& self) {
    return fmt::format("<gemsplat.Camera: {}{}x{} pixels>",
                       self.name.empty() ? "" : self.name + ", ", self.camera.width,
                       self.camera.height);
  });
  module.def(
      "load_cameras", load_cameras, py::arg("path"), py::arg("world_offset") = py::none(),
      R"(The cameras of a cameras.json, as runs hold one, in the coordinates that have `world_offset` (a
model's) taken off.)");
}

}  // namespace gs::python
