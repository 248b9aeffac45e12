// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/fit_size.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "gs_app/export/contributions.h"
#include "gs_app/run/progress_bar.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_model/edit/decimate.h"
#include "gs_model/edit/edit_model.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/edit/select.h"

namespace gs {
namespace {

constexpr std::size_t kFewest = 100;  // Gaussians; less is no picture
constexpr double kNextGuess = 0.99;   // of the count that the last size asks for

// The share of Gaussians with which an SH degree is worth its bytes, where no pictures are compared.
constexpr double kLeastShare[kMaxShDegree + 1] = {0, 0.1, 0.2, 0.5};

/// A model that only ever gets fewer Gaussians, with what pictures show of each.
class Shrinking {
 public:
  Shrinking(const GaussianModel& model, const Viewpoints* viewpoints)
      : model_(copy_with_degree(model, model.sh_degree)) {
    const bool has_cameras = viewpoints && viewpoints->training && !model.gaussians.has_time;
    const std::vector<Camera> cameras =
        has_cameras ? viewpoints->training() : std::vector<Camera>();
    if (!cameras.empty())
      shown_ = contributions_of(viewpoints->backend.renderer(), viewpoints->original, cameras,
                                viewpoints->settings, true)
                   .sum;
  }

  const GaussianModel& model() const { return model_; }
  std::size_t count() const { return model_.gaussians.count(); }

  void shrink_to(std::size_t wanted) {
    DecimateOptions options;
    std::optional<Gaussians> storage;
    if (!shown_.empty())
      options.importance = importance_of(shown_, coverages_of(drawn_gaussians(model_, storage)));
    std::vector<std::uint32_t> merged_into;
    options.merged_into = &merged_into;
    ProgressBar bar(std::int64_t(count() - wanted), true);
    options.on_progress = [&](std::size_t done, std::size_t) {
      if (bar.due(std::int64_t(done))) bar.draw(std::int64_t(done), "merges", "Gaussian");
    };
    const std::size_t left = decimate(model_.gaussians, wanted, options);
    bar.clear();
    std::vector<float> shown(shown_.empty() ? 0 : left);
    for (std::size_t i = 0; i < shown_.size(); ++i)
      if (merged_into[i] != kNotRendered) shown[merged_into[i]] += shown_[i];
    shown_ = std::move(shown);
  }

 private:
  GaussianModel model_;
  std::vector<float> shown_;  // (N) sums of blending weights, in pixels; empty: not known
};

/// What fits with one SH degree.
struct Candidate {
  GaussianModel model;
  double psnr = 0;  // against the original; 0: not measured
};

/// The model with the degree and as many Gaussians as fit; none where no picture would be left.
std::optional<GaussianModel> fit_degree(Shrinking& work, int degree, std::uint64_t bytes,
                                        const FileSize& size_of) {
  for (double caution = 1;; caution *= kNextGuess) {
    GaussianModel model = copy_with_degree(work.model(), degree);
    const std::uint64_t size = size_of(model);
    if (size <= bytes) return model;
    const auto wanted = std::size_t(double(work.count()) * double(bytes) / double(size) * caution);
    if (wanted < kFewest || model.gaussians.has_time) return {};
    work.shrink_to(wanted);
  }
}

[[noreturn]] void does_not_fit(const std::string& file, const GaussianModel& model,
                               std::uint64_t bytes) {
  throw UsageError(fmt::format(
      "{} cannot have {:.2f} MB: {}; use a larger --megabytes", file, double(bytes) / 1e6,
      model.gaussians.has_time
          ? "Gaussians that move are not merged, only dropped by gemsplat edit --decimate-by drop"
          : fmt::format("fewer than {} Gaussians would be left", kFewest)));
}

}  // namespace

GaussianModel fit_size(const GaussianModel& model, std::uint64_t bytes, const FileSize& size_of,
                       const Viewpoints* viewpoints, const std::string& file) {
  if (size_of(model) <= bytes) return copy_with_degree(model, model.sh_degree);
  const bool is_compared = viewpoints && !viewpoints->cameras.empty();
  Shrinking work(model, viewpoints);
  std::optional<Candidate> best;
  int degree = 0;  // the highest one that needs no merges is better than those below it
  while (size_of(copy_with_degree(model, degree + 1)) <= bytes) ++degree;
  for (; degree <= model.sh_degree; ++degree) {
    std::optional<GaussianModel> fitted = fit_degree(work, degree, bytes, size_of);
    if (!fitted) break;
    Candidate found{std::move(*fitted)};
    const std::size_t count = found.model.gaussians.count();
    if (is_compared) {
      found.psnr = fidelity_of(found.model, *viewpoints).psnr;
      log_info("{} Gaussians of SH degree {} fit: {:.2f} dB against the model", count, degree,
               found.psnr);
      if (best && found.psnr <= best->psnr) continue;
    } else if (best && double(count) < kLeastShare[degree] * double(model.gaussians.count())) {
      break;
    }
    best = std::move(found);
  }
  if (!best) does_not_fit(file, model, bytes);
  return std::move(best->model);
}

}  // namespace gs
