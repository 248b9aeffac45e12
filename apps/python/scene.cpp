// SPDX-License-Identifier: Apache-2.0
// gemsplat.Scene: posed photos and points, loaded from a folder or given as arrays.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>

#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/module.h"
#include "data_loaders/cameras/camera_file.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_app/jobs/keywords.h"
#include "gs_core/error.h"

namespace gs::python {
namespace {

/// A view of a scene that it keeps alive.
struct SceneView {
  ScenePointer scene;
  const View* view;
};

// The bytes of a photo or mask, which keep all that they lie in; nothing where there are none.
std::optional<py::array_t<std::uint8_t>> pixels_of(const SceneView& self, Image8 View::*member) {
  using Kept = std::pair<ScenePointer, std::shared_ptr<const View>>;
  std::shared_ptr<Kept> kept;
  {
    const py::gil_scoped_release release;
    kept = std::make_shared<Kept>(self.scene, with_photo(*self.view));
  }
  const Image8& image = (*kept->second).*member;
  if (image.empty()) return {};
  Shape shape{image.height, image.width};
  if (image.channels > 1) shape.push_back(image.channels);
  return array_in(image.pixels.data(), shape, {}, keep_alive(kept), false);
}

// ---- from arrays, which gemsplat/_classes.py has checked ----------------------------------------

using Pairs = std::vector<std::pair<NamedCamera, ByteArray>>;

std::vector<View> views_from(const Pairs& pairs) {
  std::vector<View> views;
  for (const auto& [named, photo] : pairs) {
    View& view = views.emplace_back(
        View{named.name, named.camera, Image8(named.camera.width, named.camera.height, 3)});
    std::copy_n(photo.data(), photo.size(), view.photo.pixels.begin());
    if (view.name.empty()) view.name = fmt::format("view {:05d}", views.size() - 1);
  }
  std::stable_sort(views.begin(), views.end(),
                   [](const View& a, const View& b) { return a.name < b.name; });
  return views;
}

ScenePointer scene_from(const Pairs& train, const Pairs& test, const FloatArray& points,
                        const ByteArray& colors) {
  auto made = std::make_shared<LoadedScene>();
  Scene& scene = made->scene;
  scene.train_views = views_from(train);
  scene.test_views = views_from(test);
  scene.points.resize(std::size_t(points.shape(0)));
  for (std::size_t i = 0; i < scene.points.size(); ++i) {
    const auto row = py::ssize_t(i);
    scene.points[i].position = {points.at(row, 0), points.at(row, 1), points.at(row, 2)};
    std::copy_n(colors.data(row, 0), 3, scene.points[i].color.begin());
  }
  scene.source = "arrays";
  scene.extent = camera_extent(scene.train_views);
  std::set<float> times;
  for (const std::vector<View>* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views) times.insert(view.camera.time);
  scene.time_count = times.size();
  return made;
}

ScenePointer load_from(const std::filesystem::path& path, const std::string& settings) {
  Config config;
  apply_settings(config, Json::parse(settings));
  config.dataset.source = std::filesystem::absolute(path).lexically_normal().string();
  validate(config);
  return load(config);
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
      "photo", [](const SceneView& self) { return pixels_of(self, &View::photo).value(); },
      R"((height, width, 3) uint8, sRGB, of the camera's size: undistorted and resized. Read-only, and no
copy. If the scene does not fit into memory, the photo is decoded now.)");
  view.def_property_readonly(
      "mask", [](const SceneView& self) { return pixels_of(self, &View::mask); },
      "(height, width) uint8: 255 trains, 0 does not; None if every pixel trains. Read-only.");
  view.def_property_readonly(
      "exposure", [](const SceneView& self) { return three_of(self.view->exposure); },
      "Factors of red, green and blue: the photo shows exposure times the scene's colors; 1 "
      "without exposures.");
  view.def("__repr__",
           [](const SceneView& self) { return "<gemsplat.View: " + self.view->name + ">"; });
}

}  // namespace

ScenePointer load(const Config& config) {
  const Work work;
  auto loaded = std::make_shared<LoadedScene>();
  // A scene may be loaded before its run is known, so normal maps that are named are read as well.
  const DatasetConfig& dataset = config.dataset;
  const SceneNeeds needs{.normal_maps =
                             config.surface.prior_weight > 0 || !dataset.normals.empty()};
  loaded->scene = load_scene(dataset, {}, PhotoLoading::as_they_fit, needs);
  loaded->dataset = dataset;
  return loaded;
}

void bind_scene(py::module_& module) {
  bind_view(module);
  py::class_<LoadedScene, ScenePointer> scene(
      module, "Scene",
      "Posed photos, split into those to train on and those held out, and the points to start "
      "from.");
  const auto views = [&](const char* name, std::vector<View> Scene::*member, const char* meaning) {
    scene.def_property_readonly(
        name,
        [=](const ScenePointer& self) {
          std::vector<SceneView> result;
          for (const View& view : self->scene.*member) result.push_back({self, &view});
          return result;
        },
        meaning);
  };
  // Rows lie in ScenePoint, three elements each.
  const auto points = [&](const char* name, auto first, const char* meaning) {
    scene.def_property_readonly(
        name,
        [=](const ScenePointer& self) {
          const std::vector<ScenePoint>& all = self->scene.points;
          const auto* const data = all.empty() ? nullptr : first(all[0]);
          return array_in(data, {py::ssize_t(all.size()), 3}, {sizeof(ScenePoint), sizeof *data},
                          keep_alive(self), false);
        },
        meaning);
  };
  scene.def(py::init(&scene_from));
  views("train_views", &Scene::train_views, "List of View, sorted by name.");
  views("test_views", &Scene::test_views,
        "List of View, sorted by name; empty if none is held out.");
  points(
      "points", [](const ScenePoint& point) { return &point.position.x; },
      "(M, 3) float32: sparse points, world units. Read-only, no copy.");
  points(
      "point_colors", [](const ScenePoint& point) { return point.color.data(); },
      "(M, 3) uint8: their colors, sRGB. Read-only, no copy.");
  scene.def_property_readonly(
      "extent", [](const LoadedScene& self) { return self.scene.extent; },
      "Radius of the cameras' positions in world units; scales the learning rate of the means.");
  scene.def_property_readonly(
      "source", [](const LoadedScene& self) { return self.scene.source; }, "Its folder.");
  scene.def_property_readonly(
      "world_offset", [](const LoadedScene& self) { return three_of(self.scene.world_offset); },
      "Three floats that were subtracted from all coordinates; 0 for most scenes.");
  scene.def("__repr__", [](const LoadedScene& self) {
    return fmt::format("<gemsplat.Scene: {} views to train on, {} held out, {} points>",
                       self.scene.train_views.size(), self.scene.test_views.size(),
                       self.scene.points.size());
  });
  module.def("load_scene", load_from, py::call_guard<py::gil_scoped_release>());
}

}  // namespace gs::python
