// SPDX-License-Identifier: Apache-2.0
#include "gs_app/edit/edit_step.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_app/run/progress_bar.h"
#include "gs_core/error.h"
#include "gs_core/system/text/parse_number.h"
#include "gs_model/edit/model_moment.h"
#include "gs_model/edit/places/words.h"

namespace gs {
namespace {

constexpr Quat<double> kNoTurn{1, 0, 0, 0};

/// What makes a step of its value; `what` is the step as it was written, for messages.
using MakeStep =
    std::function<EditStep(const std::string& what, const std::string& value, const EditOptions&)>;
struct StepKind {
  EditStepKind shown;
  MakeStep make;
};

Vec3d vector_of(const std::string& value, const std::string& what) {
  const std::vector<double> numbers = numbers_of_list(value, 3, what);
  return {numbers[0], numbers[1], numbers[2]};
}

double number_of(const std::string& value, const std::string& what) {
  return numbers_of_list(value, 1, what)[0];
}

/// A step that has nothing to say.
template <class F>
EditStep silent(const std::string& what, F&& apply) {
  return {what, false, false, [apply](EditSession& session) {
            apply(session);
            return std::string();
          }};
}

EditStep transforming(const std::string& what, const ModelTransform& transform) {
  return silent(what, [transform](EditSession& s) { transform_edited(s.model, transform); });
}

// --- Choosing

MakeStep choosing(bool keeps) {
  return [keeps](const std::string& what, const std::string& value, const EditOptions& options) {
    const Selection selection = selection_of(value, options.places);
    EditStep step = silent(what, [selection, keeps](EditSession& s) {
      keep_rows(s.model, rows_marked(selection.marks(s.model, s.tools), keeps));
    });
    step.needs_cameras = selection.needs_cameras;
    return step;
  };
}

// --- Moving

EditStep turning(const std::string& what, const std::string& value, const EditOptions& options) {
  return transforming(what,
                      transform_about(options.about, turn_by_degrees(vector_of(value, what)), 1));
}

EditStep moving(const std::string& what, const std::string& value, const EditOptions&) {
  return transforming(what, {-vector_of(value, what), kNoTurn, 1});
}

EditStep scaling(const std::string& what, const std::string& value, const EditOptions& options) {
  const double factor = number_of(value, what);
  if (!(factor >= 1e-6 && factor <= 1e6))
    throw UsageError(what + ": a factor is at least 1e-6 and at most 1e6");
  return transforming(what, transform_about(options.about, kNoTurn, factor));
}

EditStep upright(const std::string& what, const std::string& value, const EditOptions& options) {
  const Vec3d up = vector_of(value, what);
  if (up == Vec3d(0.0)) throw UsageError(what + ": 0,0,0 has no direction");
  return transforming(what, transform_about(options.about, turn_upright(up), 1));
}

EditStep recentering(const std::string& what, const std::string&, const EditOptions&) {
  return silent(what, [](EditSession& s) {
    const Vec3d middle = median_mean(s.model.model) + s.model.model.world_offset;
    transform_edited(s.model, {middle, kNoTurn, 1});
  });
}

EditStep straightening(const std::string& what, const std::string&, const EditOptions&) {
  return {what, false, true, [](EditSession& s) {
            const Straightened done = straighten(s.model);
            return fmt::format("turned by {:.1f} degrees, as {} say", done.degrees,
                               done.by_cameras ? "the cameras" : "level surfaces");
          }};
}

EditStep restoring_frame(const std::string& what, const std::string&, const EditOptions&) {
  return {what, false, false, [](EditSession& s) {
            const bool was_moved = s.model.input_from_model.has_value();
            restore_frame(s.model);
            return std::string(was_moved ? "" : "the model was not moved");
          }};
}

// --- Making less

// Where cameras are known, what they show of each Gaussian says which merges they see.
void merge_to(EditSession& session, std::size_t count) {
  const GaussianModel& model = session.model.model;
  const std::size_t all = model.gaussians.count();
  DecimateOptions merging;
  if (!session.model.cameras.empty() && !model.gaussians.has_time && count < all) {
    std::optional<Gaussians> storage;
    merging.importance = importance_of(sampled_contributions(session.model, session.tools).sum,
                                       coverages_of(drawn_gaussians(model, storage)));
  }
  ProgressBar bar(std::int64_t(all - std::min(all, count)), session.tools.show_progress);
  merging.on_progress = [&](std::size_t done, std::size_t) {
    if (bar.due(std::int64_t(done))) bar.draw(std::int64_t(done), "merges", "Gaussian");
  };
  decimate_by_merging(session.model, count, merging);
  bar.clear();
}

EditStep decimating(const std::string& what, const std::string& value, const EditOptions& options) {
  const Amount amount = amount_of(value, what);
  const auto decimate = options.decimates_by_merging ? merge_to : decimate_by_dropping;
  EditStep step = silent(what, [amount, decimate](EditSession& s) {
    decimate(s, amount.of(s.model.model.gaussians.count()));
  });
  step.likes_cameras = true;
  return step;
}

EditStep limiting_sh(const std::string& what, const std::string& value, const EditOptions&) {
  const double degree = number_of(value, what);
  if (degree != std::floor(degree) || degree < 0 || degree > kMaxShDegree)
    throw UsageError(fmt::format("{}: SH degrees are 0 to {}", what, kMaxShDegree));
  return silent(what, [degree = int(degree), what](EditSession& s) {
    if (degree > s.model.model.sh_degree)
      throw UsageError(
          fmt::format("{}: the model has SH degree {}; only training adds higher ones "
                      "(gemsplat train --from)",
                      what, s.model.model.sh_degree));
    limit_sh_degree(s.model.model, degree);
  });
}

EditStep taking_moment(const std::string& what, const std::string& value, const EditOptions&) {
  const double time = number_of(value, what);
  if (!(time >= 0 && time <= 1)) throw UsageError(what + ": times are 0 to 1");
  return silent(what, [time, what](EditSession& s) {
    if (!s.model.model.gaussians.has_time)
      throw UsageError(what + ": the model holds 3D Gaussians, which have no time; leave it out");
    s.model.model = moment_of(s.model.model, time);
  });
}

const std::vector<StepKind>& step_kinds() {
  static const std::vector<StepKind> kKinds = {
      {{"keep", "WHAT", "keep these Gaussians and drop all others"}, choosing(true)},
      {{"drop", "WHAT", "drop these Gaussians"}, choosing(false)},
      {{"move", "X,Y,Z", "move the model by this vector, in world units"}, moving},
      {{"turn", "X,Y,Z",
        "turn the model by these degrees about the x axis, then the y axis, then the z axis"},
       turning},
      {{"scale", "FACTOR", "multiply all lengths by this factor"}, scaling},
      {{"up", "X,Y,Z", "turn this direction to -y, which viewers show at the top"}, upright},
      {{"recenter", "", "move the median of the means to the origin"}, recentering},
      {{"straighten", "",
        "turn the model so that its floor is level, and put the floor's middle at the origin; up "
        "is "
        "that of the cameras or, without, of level surfaces"},
       straightening},
      {{"restore-frame", "", "bring a model that was moved back to where the photos' cameras are"},
       restoring_frame},
      {{"decimate", "N|SHARE", "leave this number of Gaussians, or this share of them (0.25, 25%)"},
       decimating},
      {{"sh-degree", "0..3", "remove the SH coefficients beyond this degree"}, limiting_sh},
      {{"time", "0..1", "take this moment of Gaussians in space and time, as 3D Gaussians"},
       taking_moment},
  };
  return kKinds;
}

// Where the means lie, to say why nothing was chosen.
std::string extent_text(const EditModel& model) {
  const Box box = box_of_means(model.model.gaussians);
  const Vec3d low = box.low + model.model.world_offset, high = box.high + model.model.world_offset;
  return fmt::format("{:.4g} {:.4g} {:.4g} and {:.4g} {:.4g} {:.4g}", low.x, low.y, low.z, high.x,
                     high.y, high.z);
}

}  // namespace

std::vector<EditStepKind> edit_step_kinds() {
  std::vector<EditStepKind> result;
  for (const StepKind& kind : step_kinds()) result.push_back(kind.shown);
  return result;
}

EditStep edit_step(const std::string& name, const std::string& value, const EditOptions& options) {
  std::vector<std::string> names;
  for (const StepKind& kind : step_kinds()) {
    const std::string what = "--" + name + (kind.shown.values.empty() ? "" : " " + value);
    if (kind.shown.name == name) return kind.make(what, value, options);
    names.push_back(kind.shown.name);
  }
  throw UsageError(
      fmt::format("there is no operation {}; there are {}", name, fmt::join(names, ", ")));
}

StepReport apply_step(EditSession& session, const EditStep& step) {
  if (step.needs_cameras && session.model.cameras.empty())
    throw UsageError(step.text +
                     " needs cameras; name a run's folder, or give --data SCENE or --cameras FILE");
  StepReport report{step.text, "", session.model.model.gaussians.count(), 0};
  const std::string extent = extent_text(session.model);
  report.note = step.apply(session);
  report.after = session.model.model.gaussians.count();
  if (report.after == 0)
    throw UsageError(
        fmt::format("no Gaussian is left after {}; the means lay between {}", step.text, extent));
  return report;
}

std::size_t Amount::of(std::size_t all) const {
  return is_share ? std::max<std::size_t>(1, std::size_t(std::llround(value * double(all))))
                  : std::size_t(value);
}

Amount amount_of(const std::string& text, const std::string& what) {
  const bool is_percent = text.ends_with('%');
  double value;
  const bool is_number =
      parse_number(std::string_view(text).substr(0, text.size() - is_percent), value);
  if (is_number && is_percent) value /= 100;
  const bool is_share = is_percent || (is_number && value < 1);
  const bool is_count = value == std::floor(value) && value <= double(1ull << 53);
  if (!is_number || !(value > 0) || (is_share ? value > 1 : !is_count))
    throw UsageError(
        fmt::format("{}: \"{}\" is neither a number of Gaussians, such as 20000, nor a "
                    "share of them, such as 0.25 or 25%",
                    what, text));
  return {value, is_share};
}

void decimate_by_dropping(EditSession& session, std::size_t count) {
  const GaussianModel& model = session.model.model;
  if (model.gaussians.count() <= count) return;
  std::optional<Gaussians> storage;
  const std::vector<float> scores =
      session.model.cameras.empty() ? coverages_of(drawn_gaussians(model, storage))
                                    : training_contributions(session.model, session.tools).largest;
  keep_rows(session.model, rows_with_largest(scores, count));
}

}  // namespace gs
