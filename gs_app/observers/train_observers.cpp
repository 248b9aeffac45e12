// SPDX-License-Identifier: Apache-2.0
#include "gs_app/observers/train_observers.h"
#include "gs_eval/evaluate_run.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "data_loaders/doctor/forecast.h"
#include "gs_app/run/csv.h"
#include "gs_app/run/results.h"
#include "gs_app/run/text.h"
#include "gs_core/system/log.h"
#include "gs_model/formats/ply/ply.h"

namespace gs {
namespace {

const std::string kMetricsHeader =
    "step,loss,num_gaussians,seconds,steps_per_second,sh_degree,test_psnr,test_ssim\n";

constexpr int kTimedSteps = 50;
constexpr double kLongSeconds = 600;  // a person without a GPU asks whether it can be shorter

bool contains(const std::vector<int>& steps, int step) {
  return std::find(steps.begin(), steps.end(), step) != steps.end();
}

bool is_last(int step, Trainer& trainer) { return step == trainer.schedule().steps(); }

// What the photos of the steps after this one have of pixels, over that of this step.
double growth_of_photos(Trainer& trainer, int step) {
  const Schedule& schedule = trainer.schedule();
  const auto share = [&](int at) {
    const int factor = schedule.photo_reduction(at, trainer.scene().train_views.front().camera);
    return 1 / (double(factor) * double(factor));
  };
  double sum = 0;
  for (int later = step + 1; later <= schedule.steps(); ++later) sum += share(later);
  return sum / double(schedule.steps() - step) / share(step);
}

// What the Gaussians of later steps make of the time of a step. It grows with their square root
// (docs/lab/2026-11-cpu.md), and they grow by the same factor in each refinement.
double growth_by_gaussians(Trainer& trainer) {
  if (trainer.config().density.until_step <= 0) return 1;
  const std::size_t now = trainer.gaussian_count();
  const double most = std::sqrt(expected_gaussians_from_model(trainer.config(), now) /
                                double(std::max(now, std::size_t(1))));
  return most > 1 ? (most - 1) / std::log(most) : 1;
}

// Why later steps take longer than the first ones; nothing where they do not.
std::string why_longer(bool ramps, bool grows) {
  if (!ramps && !grows) return "";
  return fmt::format(", as {}{}{}", ramps ? "photos become larger" : "",
                     ramps && grows ? " and " : "", grows ? "Gaussians are added" : "");
}

// The settings of a smaller run, where this one takes long and has none of its own.
std::string shorter_run(const Config& config, double seconds_left) {
  const bool is_reduced = config.dataset.resolution > 1;
  if (seconds_left < kLongSeconds || is_reduced || config.model.dynamic ||
      !config.model.start_from.empty())
    return "";
  return "; a new run with -c cpu_tiny -r 2 is shorter: a small model, at half the photos' size";
}

}  // namespace

void ProgressObserver::after_step(int step, Trainer& trainer) {
  if (!bar_.due(step)) return;
  const std::string detail = fmt::format("loss {:.4f} | {} Gaussians", trainer.loss(),
                                         with_commas(trainer.gaussian_count()));
  bar_.draw(step, detail, "step");
}

void DurationObserver::after_step(int step, Trainer& trainer) {
  const int left = trainer.schedule().steps() - step;
  if (step != first_step_ + kTimedSteps || left < kTimedSteps) return;
  const double seconds = trainer.train_seconds() - first_seconds_;
  progress_.clear();
  const double photos = growth_of_photos(trainer, step), gaussians = growth_by_gaussians(trainer);
  const double seconds_left = seconds / kTimedSteps * left * photos * gaussians;
  log_info("{} steps took {:.1f} s here: the other {} take about {}{}{}", kTimedSteps, seconds,
           with_commas(std::uint64_t(left)), duration_text(seconds_left),
           why_longer(photos > 1, gaussians > 1), shorter_run(trainer.config(), seconds_left));
}

void SaveObserver::after_step(int step, Trainer& trainer) {
  if (!contains(trainer.config().train.save_steps, step) || is_last(step, trainer)) return;
  lost_.attempt(fmt::format("the model of step {}", step),
                [&] { save_model(folder_, step, trainer); });
}

void EvaluationObserver::after_step(int step, Trainer& trainer) {
  const std::vector<View>& views = trainer.scene().test_views;
  if (views.empty() || is_last(step, trainer) || !contains(trainer.config().train.test_steps, step))
    return;
  const EvaluationOptions options = evaluation_options(trainer, MetricSet::quick);
  evaluation_ = evaluate(trainer.backend().renderer(), trainer.model().gaussians.span(), views,
                         trainer.evaluation_settings(), {}, options);
  step_ = step;
  progress_.clear();
  log_info("step {}: test {}", step, summary(evaluation_));
}

std::string metrics_up_to(const std::filesystem::path& metrics, int step) {
  return csv_rows_up_to(metrics, kMetricsHeader, step);
}

MetricsObserver::MetricsObserver(const RunFolder& folder, const EvaluationObserver& evaluations,
                                 LostWrites& lost, const std::string& rows)
    : evaluations_(evaluations), file_(folder.metrics(), kMetricsHeader, rows, lost) {
  take_rows();
}

void MetricsObserver::after_rollback(int step, Trainer&) {
  file_.cut_after(step);
  take_rows();
}

void MetricsObserver::take_rows() {
  last_row_ = 0;
  last_seconds_ = 0;
  losses_.clear();
  std::istringstream lines(file_.rows());
  for (std::string line; std::getline(lines, line);) {
    double loss = 0;
    std::sscanf(line.c_str(), "%d,%lf,%*[^,],%lf", &last_row_, &loss, &last_seconds_);
    losses_.push_back({last_row_, loss});
  }
}

void MetricsObserver::after_step(int step, Trainer& trainer) {
  const Evaluation* test = evaluations_.at(step);
  if (is_last(step, trainer) || (!test && step % trainer.config().train.log_every != 0)) return;
  write_row(step, trainer, test);
}

void MetricsObserver::finish(int step, Trainer& trainer, const Evaluation& test) {
  write_row(step, trainer, test.views.empty() ? nullptr : &test);
}

void MetricsObserver::write_row(int step, Trainer& trainer, const Evaluation* test) {
  const double seconds = trainer.train_seconds();
  const double rate = seconds > last_seconds_ ? (step - last_row_) / (seconds - last_seconds_) : 0;
  losses_.push_back({step, trainer.loss()});
  file_.add(fmt::format("{},{:.6f},{},{:.3f},{:.2f},{},", step, losses_.back().loss,
                        trainer.gaussian_count(), seconds, rate, trainer.settings().sh_degree) +
            (test ? fmt::format("{:.4f},{:.5f}\n", test->psnr, test->ssim) : std::string(",\n")));
  last_row_ = step;
  last_seconds_ = seconds;
}

void save_model(const RunFolder& folder, int step, Trainer& trainer) {
  if (trainer.config().model.filter_3d)
    write_gaussian_ply(folder.raw_ply(step), raw_model(trainer));
  write_gaussian_ply(folder.ply(step), trained_model(trainer));
}

}  // namespace gs
