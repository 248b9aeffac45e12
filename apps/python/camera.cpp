// SPDX-License-Identifier: Apache-2.0
// gemsplat.Camera: a pinhole or a lens, with a pose.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <array>

#include "apps/python/arrays.h"
#include "apps/python/module.h"
#include "data_loaders/cameras/camera_file.h"
#include "data_loaders/lenses/lens_range.h"
#include "gs_core/error.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/lens/lens_projection.h"

namespace gs::python {
namespace {

using Pose = std::array<std::array<double, 4>, 3>;

float checked_time(double time) {
  if (!(time >= 0 && time <= 1))
    throw UsageError(fmt::format("the time must lie between 0 and 1, but is {}", time));
  return float(time);
}

/// The lens of a word of LENSES and of four numbers.
CameraLens<double> lens_of(const PinholeCamera<double>& camera, const std::string& word,
                           const std::array<double, 4>& d) {
  if (word == "pinhole") return {};
  if (word == "orthographic") return endless_lens<double>(Lens::orthographic);
  const CameraModel model = word == "fisheye" ? CameraModel::opencv_fisheye : CameraModel::opencv;
  const ColmapCamera colmap{1,
                            model,
                            camera.width,
                            camera.height,
                            {camera.fx, camera.fy, camera.cx, camera.cy, d[0], d[1], d[2], d[3]}};
  return camera_with_lens(lens_camera(colmap, "of the camera"), "of the camera").lens;
}

// Of numbers that gemsplat/_classes.py has checked, but for the time.
NamedCamera make_camera(int width, int height, double fx, double fy, double cx, double cy,
                        const Pose& pose, const std::string& name, double time,
                        const std::string& lens, const std::array<double, 4>& distortion) {
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
  camera.lens = lens_of(camera, lens, distortion);
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

/// A camera whose lens is that of gsplat's camera_model "fisheye" or "ortho": equidistant in front of
/// the camera, or parallel rays; depths lie along the axis.
NamedCamera camera_of_model(int width, int height, const std::string& model) {
  const bool is_fisheye = model == "fisheye";
  Camera camera{width, height};
  camera.lens = endless_lens<float>(is_fisheye ? Lens::fisheye : Lens::orthographic);
  if (is_fisheye) camera.lens.radius = float(kWideAngle);  // what lies beyond is seen the same way
  return {model, camera};
}

NamedCamera at_other_resolution(const NamedCamera& named, int resolution) {
  if (resolution < 1) throw UsageError("the resolution must be 1 or more");
  return {named.name, at_resolution(named.camera, resolution)};
}

}  // namespace

void bind_camera(py::module_& module) {
  py::class_<NamedCamera> camera(
      module, "Camera",
      R"(A pinhole camera, or one that sees through a lens. Pixel (i, j) has its center at (i + 0.5, j + 0.5); the camera's
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
  camera.def_property_readonly(
      "lens", [](const NamedCamera& self) { return word_of(self.camera.lens.lens); },
      "pinhole, fisheye, orthographic, radial_tangential, or another lens of a camera that was "
      "read.");
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
  module.def("camera_of_model", camera_of_model);
  module.attr("MOST_PIXELS") = kMaxPictureSide;
}

}  // namespace gs::python
