// SPDX-License-Identifier: Apache-2.0
#include "gs_app/edit/selection.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "data_loaders/photos/photo_names.h"
#include "gs_app/edit/lasso.h"
#include "gs_app/export/contributions.h"
#include "gs_app/pictures/pictures.h"
#include "gs_core/config/text/nearest_word.h"
#include "gs_core/error.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/rotation.h"
#include "gs_model/edit/model_moment.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_train/density/floaters.h"

namespace gs {
namespace {

using MarksOf = std::function<Marks(const EditModel&, const EditTools&)>;

std::size_t count_of(const EditModel& model) { return model.model.gaussians.count(); }

/// A selection by one number of each Gaussian: `values` gives all of them.
template <class F>
MarksOf by_value(const Interval& range, F&& values) {
  return [range, values](const EditModel& model, const EditTools& tools) {
    const auto all = values(model, tools);
    return marks_where(all.size(), [&](std::size_t i) { return range.holds(double(all[i])); });
  };
}

// --- Places

MarksOf in_place(Place holds, bool whole) {
  return [holds, whole](const EditModel& model, const EditTools&) {
    std::optional<Gaussians> storage;
    std::vector<Vec3f> reaches;
    if (whole) reaches = reaches_of(drawn_gaussians(model.model, storage));
    return marks_where(count_of(model), [&](std::size_t i) {
      const Vec3d position = Vec3d(model.model.gaussians.mean[i]) + model.model.world_offset;
      return holds(position, whole ? Vec3d(reaches[i]) : Vec3d(0.0));
    });
  };
}

// --- Cameras

MarksOf in_view(const std::string& name) {
  return [name](const EditModel& model, const EditTools&) {
    std::vector<Camera> cameras;
    if (name == "all")
      for (const EditCamera& camera : model.cameras) cameras.push_back(camera.camera);
    else
      cameras.push_back(camera_named(model, name).camera);
    return marks_where(count_of(model), [&](std::size_t i) {
      const Vec3f& mean = model.model.gaussians.mean[i];
      return std::any_of(cameras.begin(), cameras.end(),
                         [&](const Camera& camera) { return is_in_picture(camera, mean); });
    });
  };
}

MarksOf in_lasso(const std::string& file) {
  return [file](const EditModel& model, const EditTools&) {
    const Lasso lasso = read_lasso(file, model.model.world_offset);
    return marks_where(count_of(model),
                       [&](std::size_t i) { return lasso.holds(model.model.gaussians.mean[i]); });
  };
}

std::vector<float> camera_distances(const EditModel& model, const EditTools&) {
  std::vector<Vec3f> positions;
  for (const EditCamera& camera : model.cameras)
    if (!camera.is_test) positions.push_back(camera.camera.position());
  return distances_to_nearest(model.model.gaussians, positions);
}

constexpr double kMostWitnesses = 1e6;

// SHARE, or SHARE,VIEWS: the clearance, and how many photos spare a Gaussian (floaters.h).
MarksOf floaters_by(const std::string& what, const std::string& value) {
  const bool has_views = value.find(',') != value.npos;
  const std::vector<double> numbers = numbers_of_list(value, has_views ? 2 : 1, what);
  const double clearance = numbers[0], witnesses = has_views ? numbers[1] : 1;
  if (!(clearance > 0 && clearance <= 1))
    throw UsageError(what + ": the share of the depth is above 0 and at most 1");
  if (witnesses != std::floor(witnesses) || witnesses < 1 || witnesses > kMostWitnesses)
    throw UsageError(what + ": the number of views is a whole number from 1 on");
  return [=](const EditModel& model, const EditTools& tools) {
    if (!tools.scene) throw UsageError(what + " needs the photos; name a run's folder");
    const GaussianModel there = in_photos_frame(model);
    const FloaterFinder finder(tools.scene(there.world_offset), float(clearance), int(witnesses));
    return finder.marks(there.gaussians.mean.download());
  };
}

// --- Properties

std::vector<float> opacities(const EditModel& model, const EditTools&) {
  std::optional<Gaussians> storage;
  std::vector<float> values;
  for (const float logit : drawn_gaussians(model.model, storage).logit_opacity)
    values.push_back(sigmoid(logit));
  return values;
}

std::vector<float> sizes(const EditModel& model, const EditTools&) {
  std::optional<Gaussians> storage;
  return sizes_of(drawn_gaussians(model.model, storage));
}

Marks invalid(const EditModel& model, const EditTools&) {
  const Gaussians& g = model.model.gaussians;
  Marks marks(g.count(), 1);
  for (const std::uint32_t i : finite_rows(g, model.model.sh_degree))
    marks[i] = is_degenerate(g.rotation[i]) || (g.has_time && is_degenerate(g.right_rotation[i]));
  return marks;
}

MarksOf alive_in(const Interval& range) {
  return [range](const EditModel& model, const EditTools&) {
    const Gaussians& g = model.model.gaussians;
    if (!g.has_time)
      throw UsageError(
          "time= chooses among Gaussians in space and time, and these are 3D "
          "Gaussians, which are there at all times; leave it out");
    return marks_where(g.count(), [&](std::size_t i) {
      const Life life = life_of(g, i);
      return life.begin <= range.high && life.end >= range.low;
    });
  };
}

// --- The table

/// What a kind of selection makes of its words: `what` is "NAME=VALUE", for messages.
using MakeMarks = std::function<MarksOf(const std::string& what, const std::string& value,
                                        const PlaceOptions& places)>;

struct KindOfSelection {
  SelectionKind shown;
  bool needs_cameras;
  MakeMarks make;
};

template <class F>
MakeMarks ranged(F&& values) {
  return [values](const std::string& what, const std::string& value, const PlaceOptions&) {
    return by_value(interval_of(what, value), values);
  };
}

MakeMarks axis_range(int axis) {
  return [axis](const std::string& what, const std::string& value, const PlaceOptions& places) {
    return in_place(range_of_axis(axis, interval_of(what, value)), places.whole);
  };
}

const std::vector<KindOfSelection>& kinds_of_selection() {
  static const std::vector<KindOfSelection> kKinds = {
      {{"box", "X,Y,Z,X,Y,Z", "inside of a box, by two opposite corners"},
       false,
       [](auto& what, auto& value, auto& places) {
         return in_place(box_of(what, value), places.whole);
       }},
      {{"sphere", "X,Y,Z,RADIUS", "not farther than the radius from a point"},
       false,
       [](auto& what, auto& value, auto& places) {
         return in_place(sphere_of(what, value), places.whole);
       }},
      {{"polygon", "FILE", "inside of an area in --plane: GeoJSON, or a vertex a line"},
       false,
       [](auto&, auto& value, auto& places) {
         return in_place(polygon_of(value, places.plane), places.whole);
       }},
      {{"x", "LOW..HIGH", "by a coordinate; y and z alike"}, false, axis_range(0)},
      {{"y", "LOW..HIGH", ""}, false, axis_range(1)},
      {{"z", "LOW..HIGH", ""}, false, axis_range(2)},
      {{"view", "NAME", "inside of the picture of this camera; view=all: of any camera"},
       true,
       [](auto&, auto& value, auto&) { return in_view(value); }},
      {{"lasso", "FILE", "inside of a line, or under a brush, of the viewer; hidden ones included"},
       false,
       [](auto&, auto& value, auto&) { return in_lasso(value); }},
      {{"opacity", "LOW..HIGH", "by opacity, 0 to 1"}, false, ranged(opacities)},
      {{"size", "LOW..HIGH", "by the largest of the three standard deviations, world units"},
       false,
       ranged(sizes)},
      {{"distance", "LOW..HIGH", "by the distance to the nearest training camera, world units"},
       true,
       ranged(camera_distances)},
      {{"seen", "LOW..HIGH", "by the number of training cameras that see it"},
       true,
       ranged([](const EditModel& model, const EditTools& tools) {
         return training_contributions(model, tools).views;
       })},
      {{"contribution", "LOW..HIGH", "by the largest contribution to a training view, pixels"},
       true,
       ranged([](const EditModel& model, const EditTools& tools) {
         return training_contributions(model, tools).largest;
       })},
      {{"floaters", "SHARE[,VIEWS]",
        "a photo looks through it: it is nearer than this share of the depth of the scene points "
        "around it, and fewer than VIEWS photos [1] show it among their own points"},
       false,
       [](auto& what, auto& value, auto&) { return floaters_by(what, value); }},
      {{"time", "LOW..HIGH", "there at some moment between these, 0 to 1, in space and time"},
       false,
       [](auto& what, auto& value, auto&) { return alive_in(interval_of(what, value)); }},
      {{"invalid", "", "holds NaN or infinity, or a rotation of length 0"},
       false,
       [](auto& what, auto& value, auto&) -> MarksOf {
         if (!value.empty()) throw UsageError(what + ": invalid has no value");
         return invalid;
       }},
  };
  return kKinds;
}

const KindOfSelection& kind_named(const std::string& text, const std::string& name) {
  std::vector<std::string> names;
  for (const KindOfSelection& kind : kinds_of_selection()) {
    if (kind.shown.name == name) return kind;
    names.push_back(kind.shown.name);
  }
  const std::string nearest = nearest_word(name, names);
  throw UsageError(fmt::format("{}: Gaussians cannot be chosen by {}; {}", text, name,
                               nearest.empty() ? fmt::format("there are {}", fmt::join(names, ", "))
                                               : "did you mean " + nearest + "?"));
}

}  // namespace

RenderSettings settings_for(const EditModel& model, const EditTools& tools) {
  RenderSettings settings = tools.settings;
  settings.sh_degree = model.model.sh_degree;
  settings.near_plane *= float(scale_of(model));
  settings.far_plane *= float(scale_of(model));
  return settings;
}

const EditCamera& camera_named(const EditModel& model, const std::string& name) {
  if (model.cameras.empty())
    throw UsageError(
        fmt::format("the camera {} is not known; name a run's folder, or give --data "
                    "SCENE or --cameras FILE",
                    name));
  std::vector<std::string> names;
  for (const EditCamera& camera : model.cameras) {
    if (camera.name == name || without_extension(camera.name) == name ||
        camera.name == without_extension(name))
      return camera;
    names.push_back(camera.name);
  }
  const std::string nearest = nearest_word(name, names);
  throw UsageError(fmt::format(
      "there is no camera {}; {}", name,
      nearest.empty() ? fmt::format("there are {} cameras, such as {}", names.size(), names.front())
                      : "did you mean " + nearest + "?"));
}

namespace {

constexpr std::size_t kSampledCameras = 256;
constexpr double kSampledPixels = 100'000;  // of a picture

std::vector<Camera> training_cameras(const EditModel& model) {
  std::vector<Camera> cameras;
  for (const EditCamera& camera : model.cameras)
    if (!camera.is_test) cameras.push_back(camera.camera);
  return cameras;
}

Camera with_pixels_up_to(const Camera& camera, double most) {
  const double pixels = double(camera.width) * double(camera.height);
  if (pixels <= most) return camera;
  const double scale = std::sqrt(most / pixels);
  const auto side = [scale](int length) { return std::max(1, int(std::lround(scale * length))); };
  return resized(camera, side(camera.width), side(camera.height));
}

Contributions contributions_to(const std::vector<Camera>& cameras, const EditModel& model,
                               const EditTools& tools) {
  Backend& backend = tools.backend();
  const Gaussians gaussians = copy_to(backend.memory(), model.model);
  return contributions_of(backend.renderer(), gaussians.span(), cameras, settings_for(model, tools),
                          tools.show_progress);
}

}  // namespace

Contributions training_contributions(const EditModel& model, const EditTools& tools) {
  return contributions_to(training_cameras(model), model, tools);
}

Contributions sampled_contributions(const EditModel& model, const EditTools& tools) {
  const std::vector<Camera> all = training_cameras(model);
  std::vector<Camera> some;
  for (const std::size_t i : evenly_chosen(all.size(), kSampledCameras))
    some.push_back(with_pixels_up_to(all[i], kSampledPixels));
  return contributions_to(some, model, tools);
}

Selection selection_of(const std::string& text, const PlaceOptions& places) {
  const std::size_t end = std::min(text.find_first_of("=<>:"), text.size());
  const std::string name = text.substr(0, end);
  const KindOfSelection& kind = kind_named(text, name);
  const std::string value = text.substr(end).starts_with('=') ? text.substr(end + 1) : "";
  if (value.empty() && !kind.shown.values.empty())
    throw UsageError(fmt::format("{} needs a value: {}={}", text, name, kind.shown.values));
  return {text, kind.needs_cameras, kind.make(text, value, places)};
}

std::vector<SelectionKind> selection_kinds() {
  std::vector<SelectionKind> result;
  for (const KindOfSelection& kind : kinds_of_selection()) result.push_back(kind.shown);
  return result;
}

}  // namespace gs
