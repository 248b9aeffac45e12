// SPDX-License-Identifier: Apache-2.0
// The exact renderer for gemsplat/_numpy.py, which has checked its arrays: one view a call, arrays
// by name.
#include <pybind11/stl.h>

#include <map>

#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/module.h"
#include "data_loaders/cameras/camera_file.h"
#include "gs_render/exact/dual.h"
#include "gs_render/exact/exact_renderer.h"

namespace gs::python {
namespace {

using DoubleArray = py::array_t<double, py::array::c_style | py::array::forcecast>;
using NamedArrays = std::map<std::string, DoubleArray>;

/// The arrays that a picture is drawn from. `slopes` has others of the same names and shapes, or
/// none.
struct Inputs {
  NamedArrays values, slopes;
};

/// How it is drawn.
struct Picture {
  int width, height, sh_degree, channels;
  CameraLens<double> lens;
  ExactSettings settings;

  explicit Picture(const py::dict& given)
      : width(given["width"].cast<int>()), height(given["height"].cast<int>()),
        sh_degree(given["sh_degree"].cast<int>()), channels(given["channels"].cast<int>()) {
    settings.splat.near_plane = given["near"].cast<float>();
    settings.splat.far_plane = given["far"].cast<float>();
    settings.splat.blur = given["blur"].cast<float>();
    settings.splat.antialias = given["antialiased"].cast<bool>();
    settings.splat.antialias_detach = false;
    settings.rule = given["blend_rule"].cast<std::string>() == "classic" ? BlendRule::classic
                                                                         : BlendRule::faster_gs;
    settings.is_smooth = given["smooth"].cast<bool>();
    if (given.contains("camera"))
      lens = lens_as<double>(given["camera"].cast<NamedCamera>().camera.lens);
  }
};

double number_of(double value, double, double) { return value; }
Dual number_of(double value, double slope, Dual) { return {value, slope}; }
double shown(double number) { return number; }
double shown(const Dual& number) { return number.slope; }

/// The array of a name as rows, each of which is nothing but numbers T; empty where it is absent.
template <class T, class Row = T>
std::vector<Row> rows_of(const Inputs& inputs, const char* name) {
  const auto values = inputs.values.find(name);
  if (values == inputs.values.end()) return {};
  const auto slopes = inputs.slopes.find(name);
  const std::size_t size = std::size_t(values->second.size());
  std::vector<Row> rows(size / (sizeof(Row) / sizeof(T)));
  T* const numbers = reinterpret_cast<T*>(rows.data());
  for (std::size_t i = 0; i < size; ++i)
    numbers[i] = number_of(values->second.data()[i],
                           slopes == inputs.slopes.end() ? 0 : slopes->second.data()[i], T());
  return rows;
}

/// The numbers of such rows; of Duals their slopes.
template <class T, class Row>
DoubleArray array_of(const std::vector<Row>& rows, const Shape& shape) {
  DoubleArray array(shape);
  const T* const numbers = reinterpret_cast<const T*>(rows.data());
  double* const to = array.mutable_data();
  for (py::ssize_t i = 0; i < array.size(); ++i) to[i] = shown(numbers[i]);
  return array;
}

template <class T>
ExactGaussians<T> gaussians_of(const Inputs& inputs, const Picture& picture) {
  ExactGaussians<T> gaussians;
  gaussians.means = rows_of<T, Vec3<T>>(inputs, "means");
  gaussians.rotations = rows_of<T, Quat<T>>(inputs, "rotations");
  gaussians.log_scales = rows_of<T, Vec3<T>>(inputs, "log_scales");
  gaussians.covariances = rows_of<T, Sym3<T>>(inputs, "covariances");
  gaussians.opacities = rows_of<T>(inputs, "opacities");
  gaussians.colors = rows_of<T, Vec3<T>>(inputs, "colors");
  gaussians.sh = rows_of<T, Vec3<T>>(inputs, "sh");
  gaussians.features = rows_of<T>(inputs, "features");
  gaussians.sh_degree = picture.sh_degree;
  gaussians.channels = picture.channels;
  return gaussians;
}

template <class T>
ExactView<T> view_of(const Inputs& inputs, const Picture& picture) {
  const std::vector<T> pose = rows_of<T>(inputs, "viewmats"), K = rows_of<T>(inputs, "Ks");
  const auto row = [&](int i) { return Vec3<T>(pose[4 * i], pose[4 * i + 1], pose[4 * i + 2]); };
  ExactView<T> view;
  PinholeCamera<T>& camera = view.camera;
  camera.width = picture.width;
  camera.height = picture.height;
  camera.fx = K[0], camera.cx = K[2];
  camera.fy = K[4], camera.cy = K[5];
  camera.lens = lens_as<T>(picture.lens);
  camera.cam_from_world_rotation = {row(0), row(1), row(2)};
  camera.cam_from_world_translation = {pose[3], pose[7], pose[11]};
  view.background = rows_of<T, Vec3<T>>(inputs, "background")[0];
  view.screen = rows_of<T, Vec2<T>>(inputs, "screen");
  return view;
}

template <class T>
py::dict arrays_of(const ExactPicture<T>& drawn, const Picture& picture) {
  const py::ssize_t height = picture.height, width = picture.width;
  py::dict arrays;
  arrays["image"] = array_of<T>(drawn.image, {height, width, 3});
  arrays["alpha"] = array_of<T>(drawn.alpha, {height, width});
  arrays["depth"] = array_of<T>(drawn.depth, {height, width});
  arrays["inverse_depth"] = array_of<T>(drawn.inverse_depth, {height, width});
  arrays["features"] = array_of<T>(drawn.features, {height, width, picture.channels});
  return arrays;
}

/// What a function of C++ returns, called without the GIL.
template <class F>
auto computed(F&& function) {
  const py::gil_scoped_release release;
  const Work work;
  return function();
}

py::dict picture(const NamedArrays& values, const py::dict& settings) {
  const Picture picture(settings);
  const Inputs inputs{values, {}};
  const auto gaussians = gaussians_of<double>(inputs, picture);
  const auto view = view_of<double>(inputs, picture);
  py::dict arrays = arrays_of(
      computed([&] { return exact_picture(gaussians, view, picture.settings); }), picture);
  const ExactFootprints footprints =
      computed([&] { return exact_footprints(gaussians, view, picture.settings); });
  const auto count = py::ssize_t(gaussians.count());
  arrays["means2d"] = array_of<double>(footprints.means2d, {count, 2});
  arrays["depths"] = array_of<double>(footprints.depths, {count});
  arrays["conics"] = array_of<double>(footprints.conics, {count, 3});
  arrays["radii"] = py::array_t<int>(count, footprints.radii.data());
  return arrays;
}

/// How the picture changes where the inputs change by `slopes`.
py::dict slopes(const NamedArrays& values, const NamedArrays& slopes, const py::dict& settings) {
  const Picture picture(settings);
  const Inputs inputs{values, slopes};
  const auto gaussians = gaussians_of<Dual>(inputs, picture);
  const auto view = view_of<Dual>(inputs, picture);
  return arrays_of(computed([&] { return exact_picture(gaussians, view, picture.settings); }),
                   picture);
}

/// The gradients by all inputs, also those by viewmats and Ks, from dL/d(picture).
py::dict gradients(const NamedArrays& values, const NamedArrays& dL_dpicture,
                   const py::dict& settings) {
  const Picture picture(settings);
  const Inputs inputs{values, {}}, given{dL_dpicture, {}};
  const auto gaussians = gaussians_of<double>(inputs, picture);
  const auto view = view_of<double>(inputs, picture);
  const ExactPicture<double> dL{rows_of<double, Vec3d>(given, "image"),
                                rows_of<double>(given, "alpha"), rows_of<double>(given, "depth"),
                                rows_of<double>(given, "inverse_depth"),
                                rows_of<double>(given, "features")};
  const ExactGradients found =
      computed([&] { return exact_gradients(gaussians, view, picture.settings, dL); });
  const CameraEntriesGradient<double>& camera = found.camera;
  const Mat3<double>& R = camera.rotation;
  const Vec3d& t = camera.translation;
  py::dict arrays;
  const auto put = [&](const char* name, const auto& rows) {
    if (const auto like = values.find(name); like != values.end())
      arrays[name] = array_of<double>(
          rows, Shape(like->second.shape(), like->second.shape() + like->second.ndim()));
  };
  put("means", found.means);
  put("rotations", found.rotations);
  put("log_scales", found.log_scales);
  put("covariances", found.covariances);
  put("opacities", found.opacities);
  put("colors", found.colors);
  put("sh", found.sh);
  put("features", found.features);
  put("screen", found.screen);
  put("absolute_screen", found.absolute_screen);
  put("background", std::vector<Vec3d>{found.background});
  put("viewmats", std::vector<double>{R.row0.x, R.row0.y, R.row0.z, t.x,  //
                                      R.row1.x, R.row1.y, R.row1.z, t.y,  //
                                      R.row2.x, R.row2.y, R.row2.z, t.z,  //
                                      0, 0, 0, 0});
  put("Ks", std::vector<double>{camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 0});
  return arrays;
}

/// Where the Gaussians are by the rules of another rasterizer.
py::dict footprints(const NamedArrays& values, const py::dict& settings, const std::string& shape,
                    float clip, int tile) {
  const Picture picture(settings);
  const Inputs inputs{values, {}};
  const auto gaussians = gaussians_of<double>(inputs, picture);
  const auto view = view_of<double>(inputs, picture);
  const std::vector<Footprint<double>> rows = computed([&] {
    return footprints_by_rule(gaussians, view, picture.settings.splat,
                              footprint_rule(shape, clip, tile));
  });
  const auto count = py::ssize_t(rows.size());
  const auto column = [&](const Shape& shape, auto&& of_row) {
    std::vector<std::decay_t<decltype(of_row(rows[0]))>> values;
    for (const Footprint<double>& row : rows) values.push_back(of_row(row));
    return array_of<double>(values, shape);
  };
  py::dict arrays;
  arrays["means2d"] = column({count, 2}, [](const auto& row) { return row.mean2d; });
  arrays["depths"] = column({count}, [](const auto& row) { return row.depth; });
  arrays["conics"] = column({count, 3}, [](const auto& row) { return row.conic; });
  arrays["compensations"] = column({count}, [](const auto& row) { return row.compensation; });
  arrays["radii"] =
      column({count, 2}, [](const auto& row) { return Vec2<double>(row.radius_x, row.radius_y); });
  return arrays;
}

}  // namespace

FootprintRule footprint_rule(const std::string& shape, float clip, int tile) {
  return {shape == "box" ? FootprintShape::box : FootprintShape::square, clip, tile};
}

void bind_exact(py::module_& module) {
  module.def("exact_picture", picture);
  module.def("exact_slopes", slopes);
  module.def("exact_gradients", gradients);
  module.def("exact_footprints", footprints);
}

}  // namespace gs::python
