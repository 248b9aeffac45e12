// SPDX-License-Identifier: Apache-2.0
#include "gs_app/edit/selection.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "data_loaders/formats/coding/finite_rows.h"
#include "data_loaders/formats/model_moment.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_app/edit/contributions.h"
#include "gs_app/edit/polygon_file.h"
#include "gs_core/config/nearest_word.h"
#include "gs_core/error.h"
#include "gs_core/io/parse_number.h"
#include "gs_core/math/activations.h"
#include "gs_core/math/rotation.h"

namespace gs {
namespace {

using MarksOf = std::function<Marks(const EditModel&, const EditTools&)>;

constexpr std::string_view kRange = "..";

std::size_t count_of(const EditModel& model) { return model.model.gaussians.count(); }

// "0.1..0.5", "0.1..", "..0.5", or one number.
Interval interval_of(const std::string& what, std::string_view text) {
  const auto number = [&](std::string_view word, double if_empty) {
    double value = if_empty;
    if (!word.empty() && (!parse_number(word, value) || std::isnan(value)))
      throw UsageError(
          fmt::format("{}: \"{}\" is no number; a range is written LOW..HIGH, and one "
                      "of the two may be left out, as in {}=0.5..",
                      what, word, what.substr(0, what.find('='))));
    return value;
  };
  const Interval all;
  const std::size_t dots = text.find(kRange);
  Interval interval{number(text.substr(0, dots), all.low), 0};
  interval.high =
      dots == text.npos ? interval.low : number(text.substr(dots + kRange.size()), all.high);
  const bool says_nothing = text.empty() || text == kRange;
  if (says_nothing || interval.low > interval.high)
    throw UsageError(
        fmt::format("{}: \"{}\" is no range; write LOW..HIGH, and leave out one of the "
                    "two at most",
                    what, text));
  return interval;
}

/// A selection by one number of each Gaussian: `values` gives all of them.
template <class F>
MarksOf by_value(const Interval& range, F&& values) {
  return [range, values](const EditModel& model, const EditTools& tools) {
    const auto all = values(model, tools);
    return marks_where(all.size(), [&](std::size_t i) { return range.holds(double(all[i])); });
  };
}

// --- Places

/// A place, given by whether it holds all points within `reach` of a point: along each axis.
using Holds = std::function<bool(const Vec3d& point, const Vec3d& reach)>;

MarksOf in_place(Holds holds, bool whole) {
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

Holds box_of(const std::string& what, std::string_view values) {
  const std::vector<double> c = numbers_of_list(values, 6, what);
  const Box box = box_between({c[0], c[1], c[2]}, {c[3], c[4], c[5]});
  return [box](const Vec3d& p, const Vec3d& reach) {
    return box.holds(p - reach) && box.holds(p + reach);
  };
}

Holds sphere_of(const std::string& what, std::string_view values) {
  const std::vector<double> c = numbers_of_list(values, 4, what);
  if (!(c[3] > 0)) throw UsageError(what + ": the radius must be above 0");
  return [center = Vec3d{c[0], c[1], c[2]}, r = c[3]](const Vec3d& p, const Vec3d& reach) {
    Vec3d far = p - center;  // the farthest corner of the box around the Gaussian
    for (int axis = 0; axis < 3; ++axis) far[axis] = std::abs(far[axis]) + reach[axis];
    return inner(far, far) <= r * r;
  };
}

Holds polygon_of(std::string_view file, PolygonPlane plane) {
  return [area = read_polygon(file), plane](const Vec3d& p, const Vec3d& reach) {
    for (const double a : {-1.0, 0.0, 1.0})  // corners, middles of sides, and the mean
      for (const double b : {-1.0, 0.0, 1.0})
        if (!area.holds({p[plane.first] + a * reach[plane.first],
                         p[plane.second] + b * reach[plane.second]}))
          return false;
    return true;
  };
}

Holds range_of_axis(int axis, const Interval& range) {
  return [axis, range](const Vec3d& p, const Vec3d& reach) {
    return range.holds(p[axis] - reach[axis]) && range.holds(p[axis] + reach[axis]);
  };
}

// --- Cameras

MarksOf in_view(const std::string& name) {
  return [name](const EditModel& model, const EditTools&) {
    std::vector<Camera> cameras;
    if (name == "all")
      for (const EditCamera& camera : model.cameras) cameras.push_back(camera.named.camera);
    else
      cameras.push_back(camera_named(model, name).named.camera);
    return marks_where(count_of(model), [&](std::size_t i) {
      const Vec3f& mean = model.model.gaussians.mean[i];
      return std::any_of(cameras.begin(), cameras.end(),
                         [&](const Camera& camera) { return is_in_picture(camera, mean); });
    });
  };
}

std::vector<float> camera_distances(const EditModel& model, const EditTools&) {
  std::vector<Vec3f> positions;
  for (const EditCamera& camera : model.cameras)
    if (!camera.is_test) positions.push_back(camera.named.camera.position());
  return distances_to_nearest(model.model.gaussians, positions);
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
using Make = std::function<MarksOf(const std::string& what, const std::string& value,
                                   const PlaceOptions& places)>;

struct Kind {
  SelectionKind shown;
  bool needs_cameras;
  Make make;
};

template <class F>
Make ranged(F&& values) {
  return [values](const std::string& what, const std::string& value, const PlaceOptions&) {
    return by_value(interval_of(what, value), values);
  };
}

Make axis_range(int axis) {
  return [axis](const std::string& what, const std::string& value, const PlaceOptions& places) {
    return in_place(range_of_axis(axis, interval_of(what, value)), places.whole);
  };
}

const std::vector<Kind>& kinds() {
  static const std::vector<Kind> kKinds = {
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

const Kind& kind_named(const std::string& text, const std::string& name) {
  std::vector<std::string> names;
  for (const Kind& kind : kinds()) {
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
    if (camera.named.name == name || without_extension(camera.named.name) == name ||
        camera.named.name == without_extension(name))
      return camera;
    names.push_back(camera.named.name);
  }
  const std::string nearest = nearest_word(name, names);
  throw UsageError(fmt::format(
      "there is no camera {}; {}", name,
      nearest.empty() ? fmt::format("there are {} cameras, such as {}", names.size(), names.front())
                      : "did you mean " + nearest + "?"));
}

PolygonPlane polygon_plane(std::string_view word) {
  constexpr std::string_view kAxes = "xyz";
  const auto axis = [&](std::size_t i) {
    return i < word.size() ? kAxes.find(word[i]) : kAxes.npos;
  };
  if (word.size() != 2 || axis(0) == kAxes.npos || axis(1) == kAxes.npos || axis(0) == axis(1))
    throw UsageError(fmt::format("{} is no plane; name two axes, such as xz or xy", word));
  return {int(axis(0)), int(axis(1))};
}

Contributions training_contributions(const EditModel& model, const EditTools& tools) {
  std::vector<Camera> cameras;
  for (const EditCamera& camera : model.cameras)
    if (!camera.is_test) cameras.push_back(camera.named.camera);
  Backend& backend = tools.backend();
  const Gaussians gaussians = copy_to(backend.memory(), model.model);
  return contributions_of(backend.renderer(), gaussians.span(), cameras, settings_for(model, tools),
                          tools.show_progress);
}

Selection selection_of(const std::string& text, const PlaceOptions& places) {
  const std::size_t equals = text.find('=');
  const std::string name = text.substr(0, equals);
  const Kind& kind = kind_named(text, name);
  const std::string value = equals == text.npos ? "" : text.substr(equals + 1);
  if (value.empty() && !kind.shown.values.empty())
    throw UsageError(fmt::format("{} needs a value: {}={}", text, name, kind.shown.values));
  return {text, kind.needs_cameras, kind.make(text, value, places)};
}

std::vector<SelectionKind> selection_kinds() {
  std::vector<SelectionKind> result;
  for (const Kind& kind : kinds()) result.push_back(kind.shown);
  return result;
}

std::vector<double> numbers_of_list(std::string_view text, std::size_t count,
                                    const std::string& what) {
  std::vector<double> numbers;
  for (std::string_view left = text; !left.empty() || numbers.empty();) {
    const std::size_t end = std::min(left.find(','), left.size());
    double value;
    if (!parse_number(left.substr(0, end), value) || !std::isfinite(value))
      throw UsageError(
          fmt::format("{}: \"{}\" is no number; give {} with commas between and "
                      "without spaces",
                      what, left.substr(0, end), count));
    numbers.push_back(value);
    left.remove_prefix(std::min(end + 1, left.size()));
  }
  if (numbers.size() != count)
    throw UsageError(
        fmt::format("{}: these are {} numbers, and it takes {}", what, numbers.size(), count));
  return numbers;
}

}  // namespace gs
