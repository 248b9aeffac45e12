// SPDX-License-Identifier: Apache-2.0
#include "apps/python/scene.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>

#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/settings.h"
#include "data_loaders/cameras/camera_file.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_core/error.h"

namespace gs::python {
namespace {

/// A view of a scene that it keeps alive.
struct SceneView {
  ScenePointer scene;
  const View* view;
};

/// Bytes of a photo, and all that they lie in.
struct KeptPhoto {
  ScenePointer scene;
  std::shared_ptr<const View> view;
};

std::shared_ptr<KeptPhoto> decoded(const SceneView& self) {
  const py::gil_scoped_release release;
  return std::make_shared<KeptPhoto>(KeptPhoto{self.scene, with_photo(*self.view)});
}

py::object photo_of(const SceneView& self) {
  const auto kept = decoded(self);
  const Image8& photo = kept->view->photo;
  return array_in(photo.pixels.data(), {photo.height, photo.width, photo.channels}, {},
                  keep_alive(kept), false);
}

py::object mask_of(const SceneView& self) {
  const auto kept = decoded(self);
  const Image8& mask = kept->view->mask;
  if (mask.empty()) return py::none();
  return array_in(mask.pixels.data(), {mask.height, mask.width}, {}, keep_alive(kept), false);
}

std::vector<SceneView> views_of(const ScenePointer& scene, const std::vector<View>& views) {
  std::vector<SceneView> result;
  for (const View& view : views) result.push_back({scene, &view});
  return result;
}

// ---- from a folder -----------------------------------------------------------------------------

ScenePointer load_from(const std::filesystem::path& path, const py::kwargs& settings) {
  Config config;
  merge_settings(config, settings, "dataset.");
  config.dataset.source = std::filesystem::absolute(path).lexically_normal().string();
  validate(config);
  return load(config.dataset);
}

// ---- from arrays -------------------------------------------------------------------------------

View view_from(const py::handle& pair) {
  if (!py::isinstance<py::tuple>(pair) || py::len(pair) != 2)
    throw UsageError("a view is a pair: a Camera and its photo");
  const auto parts = pair.cast<py::tuple>();
  if (!py::isinstance<NamedCamera>(parts[0]))
    throw UsageError("a view is a pair: a Camera and its photo");
  const auto& named = parts[0].cast<const NamedCamera&>();
  const Camera& camera = named.camera;
  const auto bytes = bytes_of("a photo", parts[1], {camera.height, camera.width, 3});
  View view{named.name, camera, Image8(camera.width, camera.height, 3)};
  std::copy_n(bytes.data(), bytes.size(), view.photo.pixels.begin());
  return view;
}

std::vector<View> views_from(const py::iterable& pairs) {
  std::vector<View> views;
  for (const py::handle& pair : pairs) views.push_back(view_from(pair));
  for (std::size_t i = 0; i < views.size(); ++i)
    if (views[i].name.empty()) views[i].name = fmt::format("view {:05d}", i);
  std::stable_sort(views.begin(), views.end(),
                   [](const View& a, const View& b) { return a.name < b.name; });
  return views;
}

std::vector<ScenePoint> points_from(const py::object& positions, const py::object& colors) {
  if (positions.is_none()) return {};
  const FloatArray at = floats_of("points", positions, {kAny, 3});
  std::vector<ScenePoint> points(std::size_t(at.shape(0)), {Vec3f(0), {128, 128, 128}});
  for (std::size_t i = 0; i < points.size(); ++i)
    points[i].position = {at.at(i, 0), at.at(i, 1), at.at(i, 2)};
  if (colors.is_none()) return points;
  const auto bytes = bytes_of("point_colors", colors, {at.shape(0), 3});
  for (std::size_t i = 0; i < points.size(); ++i)
    std::copy_n(bytes.data(py::ssize_t(i), 0), 3, points[i].color.begin());
  return points;
}

ScenePointer scene_from(const py::iterable& train, const py::iterable& test,
                        const py::object& points, const py::object& point_colors) {
  auto made = std::make_shared<LoadedScene>();
  Scene& scene = made->scene;
  scene.train_views = views_from(train);
  scene.test_views = views_from(test);
  scene.points = points_from(points, point_colors);
  scene.source = "arrays";
  scene.extent = camera_extent(scene.train_views);
  std::set<float> times;
  for (const std::vector<View>* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views) times.insert(view.camera.time);
  scene.time_count = times.size();
  return made;
}

void bind_view(py::module_& module) {
  py::class_<SceneView> view(module, "View", "A posed photo of a scene, which it keeps alive.");
  view.def_property_readonly(
      "name", [](const SceneView& self) { return self.view->name; },
      "The photo's name, relative to the photos' folder.");
  view.def_property_readonly(
      "camera",
      [](const SceneView& self) {
        return NamedCamera{self.view->name, self.view->camera};
      },
      "Its Camera.");
  view.def_property_readonly(
      "photo", photo_of,
      R"((height, width, 3) uint8, sRGB, of the camera's size: undistorted and resized. Read-only, and no
copy. If the scene does not fit into memory, the photo is decoded now.)");
  view.def_property_readonly(
      "mask", mask_of,
      "(height, width) uint8: 255 trains, 0 does not; None if every pixel trains. Read-only.");
  view.def_property_readonly(
      "exposure",
      [](const SceneView& self) {
        const Vec3f& exposure = self.view->exposure;
        return py::make_tuple(exposure.x, exposure.y, exposure.z);
      },
      "Factors of red, green and blue: the photo shows exposure times the scene's colors; 1 "
      "without exposures.");
  view.def("__repr__",
           [](const SceneView& self) { return "<gemsplat.View: " + self.view->name + ">"; });
}

}  // namespace

ScenePointer load(const DatasetConfig& dataset) {
  const py::gil_scoped_release release;
  const Work work;
  auto loaded = std::make_shared<LoadedScene>();
  loaded->scene = load_scene(dataset);
  loaded->dataset = dataset;
  return loaded;
}

void bind_scene(py::module_& module) {
  bind_view(module);
  // pybind11 2.10 holds no shared_ptr to const: nothing below writes.
  py::class_<LoadedScene, std::shared_ptr<LoadedScene>> scene(
      module, "Scene",
      "Posed photos, split into those to train on and those held out, and the points to start "
      "from.");
  const auto held = [](const ScenePointer& pointer) {
    return std::const_pointer_cast<LoadedScene>(pointer);
  };
  scene.def(
      py::init(
          [=](const py::iterable& train, const py::iterable& test, const py::object& points,
              const py::object& colors) { return held(scene_from(train, test, points, colors)); }),
      R"(From arrays, which are copied. train, test: pairs of a Camera and its photo, (height, width, 3)
uint8, sRGB, of the camera's size; views are sorted by their cameras' names. points: (M, 3), world
units; without points training starts at random. point_colors: (M, 3) uint8, else gray.)",
      py::arg("train"), py::arg("test") = py::tuple(), py::kw_only(),
      py::arg("points") = py::none(), py::arg("point_colors") = py::none());
  scene.def_static(
      "load",
      [=](const std::filesystem::path& path, const py::kwargs& settings) {
        return held(load_from(path, settings));
      },
      py::arg("path"),
      R"(A folder with photos and a COLMAP model, or a transforms.json. Keywords are the settings of
[dataset]: eval=True holds out every test_every-th view, resolution=4 divides the photos' size by
4, 16 and more is their width, images, masks, model, ... (docs/reference/settings.md).)");
  const auto views = [&](const char* name, std::vector<View> Scene::*member, const char* meaning) {
    scene.def_property_readonly(
        name,
        [=](const std::shared_ptr<LoadedScene>& self) {
          return views_of(self, self->scene.*member);
        },
        meaning);
  };
  views("train_views", &Scene::train_views, "List of View, sorted by name.");
  views("test_views", &Scene::test_views,
        "List of View, sorted by name; empty if none is held out.");
  scene.def_property_readonly(
      "points",
      [](const std::shared_ptr<LoadedScene>& self) {
        const auto& points = self->scene.points;
        const auto* const data = reinterpret_cast<const float*>(points.data());
        return array_in(data, {py::ssize_t(points.size()), 3}, {sizeof(ScenePoint), sizeof(float)},
                        keep_alive(self), false);
      },
      "(M, 3) float32: sparse points, world units. Read-only, no copy.");
  scene.def_property_readonly(
      "point_colors",
      [](const std::shared_ptr<LoadedScene>& self) {
        const auto& points = self->scene.points;
        const std::uint8_t* const data = points.empty() ? nullptr : points[0].color.data();
        return array_in(data, {py::ssize_t(points.size()), 3}, {sizeof(ScenePoint), 1},
                        keep_alive(self), false);
      },
      "(M, 3) uint8: their colors, sRGB. Read-only, no copy.");
  scene.def_property_readonly(
      "extent", [](const LoadedScene& self) { return self.scene.extent; },
      "Radius of the cameras' positions in world units; scales the learning rate of the means.");
  scene.def_property_readonly(
      "source", [](const LoadedScene& self) { return self.scene.source; }, "Its folder.");
  scene.def_property_readonly(
      "world_offset",
      [](const LoadedScene& self) {
        const Vec3d& offset = self.scene.world_offset;
        return py::make_tuple(offset.x, offset.y, offset.z);
      },
      "Three floats that were subtracted from all coordinates; 0 for most scenes.");
  scene.def("__repr__", [](const LoadedScene& self) {
    return fmt::format("<gemsplat.Scene: {} views to train on, {} held out, {} points>",
                       self.scene.train_views.size(), self.scene.test_views.size(),
                       self.scene.points.size());
  });
}

}  // namespace gs::python
