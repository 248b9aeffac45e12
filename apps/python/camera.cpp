// SPDX-License-Identifier: Apache-2.0
// gemsplat.Camera: an undistorted pinhole with a pose.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <array>

#include "apps/python/arrays.h"
#include "apps/python/module.h"
#include "data_loaders/cameras/camera_file.h"
#include "gs_core/error.h"
#include "gs_core/math/constants.h"

namespace gs::python {
namespace {

using Pose = std::array<std::array<double, 4>, 3>;

float checked_time(double time) {
  if (!(time >= 0 && time <= 1))
    throw UsageError(fmt::format("the time must lie between 0 and 1, but is {}", time));
  return float(time);
}

// Of numbers that gemsplat/_classes.py has checked, but for the time.
NamedCamera make_camera(int width, int height, double fx, double fy, double cx, double cy,
                        const Pose& pose, const std::string& name, double time) {
  PinholeCamera<double> camera;
  camera.width = width;
  camera.height = height;
  camera.fx = fx;
  camera.fy = fy;
  camera.cx = cx;
  camera.cy = cy;
  const auto row = [&](int i) { return Vec3d{pose[i][0], pose[i][1], pose[i][2]}; };
  camera.cam_from_world_rotation = {row(0), row(1), row(2)};
  camera.cam_from_world_translation = {pose[0][3], pose[1][3], pose[2][3]};
  camera.time = checked_time(time);
  return {name, camera_as<float>(camera)};
}

py::array_t<double> cam_from_world(const NamedCamera& named) {
  const Camera& camera = named.camera;
  const Vec3f rows[3] = {camera.cam_from_world_rotation.row0, camera.cam_from_world_rotation.row1,
                         camera.cam_from_world_rotation.row2};
  py::array_t<double> matrix(Shape{4, 4});
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

NamedCamera at_other_resolution(const NamedCamera& named, int resolution) {
  if (resolution < 1) throw UsageError("the resolution must be 1 or more");
  return {named.name, at_resolution(named.camera, resolution)};
}

}  // namespace

void bind_camera(py::module_& module) {
  py::class_<NamedCamera> camera(
      module, "Camera",
      R"(An undistorted pinhole camera. Pixel (i, j) has its center at (i + 0.5, j + 0.5); the camera's
axes are x right, y down, z forward, as in COLMAP and OpenCV. Numbers are kept as float32.)");
  const auto number = [&](const char* name, auto Camera::*member, const char* meaning) {
    camera.def_property_readonly(
        name, [=](const NamedCamera& self) { return self.camera.*member; }, meaning);
  };
  camera.def(py::init(&make_camera));
  camera.def_readonly("name", &NamedCamera::name, "Name of its photo, if it has one.");
  number("width", &Camera::width, "Pixels.");
  number("height", &Camera::height, "Pixels.");
  number("fx", &Camera::fx, "Pixels.");
  number("fy", &Camera::fy, "Pixels.");
  number("cx", &Camera::cx, "Pixels.");
  number("cy", &Camera::cy, "Pixels.");
  number("time", &Camera::time,
         "The moment of a scene that moves, from 0 to 1: a model that moves is rendered as it is "
         "then.");
  camera.def_property_readonly("cam_from_world", cam_from_world,
                               "(4, 4) float64: from world to camera coordinates. A copy.");
  camera.def_property_readonly("position", position,
                               "(3,) float64: the camera's center, world units. A copy.");
  camera.def(
      "at_time",
      [](NamedCamera self, double time) {
        self.camera.time = checked_time(time);
        return self;
      },
      py::arg("time"), "The same view at another moment, 0 to 1.");
  camera.def("at_resolution", at_other_resolution, py::arg("resolution"),
             "The same view in a smaller picture: 1 to 8 divides its size, a larger number is its "
             "new width in pixels.");
  camera.def("__repr__", [](const NamedCamera& self) {
    return fmt::format("<gemsplat.Camera: {}{}x{} pixels>",
                       self.name.empty() ? "" : self.name + ", ", self.camera.width,
                       self.camera.height);
  });
  module.def(
      "load_cameras",
      [](const std::filesystem::path& path, const std::array<double, 3>& offset) {
        return read_cameras_json(path, {offset[0], offset[1], offset[2]});
      },
      py::call_guard<py::gil_scoped_release>());
  module.attr("MOST_PIXELS") = kMaxPictureSide;
}

}  // namespace gs::python
