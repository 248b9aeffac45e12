// SPDX-License-Identifier: Apache-2.0
// Steps that the device has not reported yet. Only the device knows how many instances a photo has,
// but buffers and sorts need a number beforehand, for which there is a forecast
// (instance_forecast.h). Where the forecast is too small, the device raises a flag, and no step
// changes the model from then on. When the host sees the flag in a report, it launches those steps
// again, in order, with larger buffers. The result is that of a sufficient forecast. A loss of the
// program sees such a step again; so its report is awaited before the next step begins, while the
// device works on what follows the report.
#pragma once

#include <deque>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "cuda/photo_terms/photo_table.cuh"
#include "cuda/render/renderer.cuh"
#include "cuda/render/reports.cuh"
#include "cuda/stages.cuh"
#include "cuda/step/instance_forecast.h"

namespace gs::cuda {

/// A step that may have to be launched again. Its photos have numbers of their own, in order.
struct PendingStep : ModelUpdate {
  std::vector<TrainingPhoto> batch;
  LossSettings loss_settings;
  float position_rate;  // Adam's rate for the means, which scales the noise
  PhotoTableUpdate photometric, poses;
  std::uint32_t first_photo = 0;  // its number
  bool is_launched = false;

  PendingStep(const TrainingModel& model, const TrainingStep& step)
      : ModelUpdate{adam_steps(model.adam_steps + step.update.rule.steps, step.update.rates),
                    step.update.rule,
                    {step.update.rounding_seed, model.adam_steps + step.update.rule.steps},
                    step.density},
        batch(step.photos.begin(), step.photos.end()), loss_settings(step.loss),
        position_rate(step.update.rates.mean) {}

  std::uint32_t number_of(std::size_t photo) const { return first_photo + std::uint32_t(photo); }
  Span<const TrainingPhoto> photos() const { return {batch.data(), batch.size()}; }
};

/// What a backend does with its steps.
class StepLauncher {
 public:
  virtual ~StepLauncher() = default;
  /// Launches a step. Where this throws, for example because memory ran out, no launch of the step
  /// has changed the model.
  virtual void enqueue(const PendingStep& step) = 0;
  /// Waits for all launches.
  virtual void wait_for_launches() = 0;
  /// Waits for the reports of a step that was launched.
  virtual void wait_for_reports(const PendingStep& step) = 0;
  /// After a step that failed, and wait_for_launches(): sums and gradients are zero again.
  virtual void clear_failed_step() = 0;
  /// After steps that were halted: sums and gradients are zero again, and no step is halted any
  /// more.
  virtual void clear_halted_steps() = 0;
};

class PendingSteps {
 public:
  explicit PendingSteps(StepLauncher& launcher) : launcher_(launcher) {}

  /// Launches a step for a model of so many Gaussians. Waits while the host is too far ahead, and if
  /// `is_settled` until the step has fitted into its buffers. Where this throws, the step is dropped;
  /// earlier ones are launched later.
  void launch(PendingStep step, std::size_t gaussians, bool is_settled) {
    gaussians_ = gaussians;
    const std::size_t photos = step.batch.size();
    GS_CHECK(photos >= 1 && photos <= std::size_t(kMostBatch));
    wait_until_few_are_pending(photos);
    step.first_photo = last_photo_ + 1;
    pending_.push_back(std::move(step));
    last_photo_ += std::uint32_t(photos);
    try {
      launch_pending();
      while (is_settled && !pending_.empty()) {
        launcher_.wait_for_reports(pending_.front());
        read_reports();
      }
    } catch (...) {
      pending_.pop_back();
      last_photo_ -= std::uint32_t(photos);
      throw;
    }
  }
  /// Waits until all steps have changed the model.
  void finish() {
    while (!pending_.empty()) {
      launcher_.wait_for_launches();
      read_reports();
    }
  }
  Reports& reports() { return reports_; }
  InstanceForecast& forecast() { return forecast_; }

 private:
  static constexpr std::size_t kMostPending = 128;  // photos that the host may be ahead

  // Waits until so many photos may be launched.
  void wait_until_few_are_pending(std::size_t photos) {
    read_reports();
    while (pending_photos() + photos > kMostPending) {  // the device has enough to do
      std::this_thread::yield();
      read_reports();
    }
  }

  std::size_t pending_photos() const {
    return pending_.empty() ? 0 : last_photo_ + 1 - pending_.front().first_photo;
  }

  // Launches the steps that are not launched yet, in order. A step that fails changes nothing; the
  // next call launches it again, with those after it.
  void launch_pending() {
    for (PendingStep& step : pending_) {
      if (step.is_launched) continue;
      try {
        launcher_.enqueue(step);
      } catch (...) {
        // A late report must not be mistaken for that of the next attempt.
        launcher_.wait_for_launches();
        launcher_.clear_failed_step();
        throw;
      }
      step.is_launched = true;
    }
  }

  // Removes the steps that fitted into their buffers, and repeats the others. Waits only where it
  // repeats.
  void read_reports() {
    launch_pending();
    while (!pending_.empty()) {
      const std::optional<bool> is_halted = is_first_halted();
      if (!is_halted) return;
      if (*is_halted) return repeat_pending();
      drop_first();
    }
  }

  // Nothing while reports of the first step are missing.
  std::optional<bool> is_first_halted() {
    bool is_halted = false;
    for (std::size_t i = 0; i < pending_.front().batch.size(); ++i) {
      StepReport report;
      if (!reports_.read(pending_.front().number_of(i), report)) return std::nullopt;
      is_halted |= report.halted != 0;
    }
    return is_halted;
  }

  void drop_first() {
    note_instances(pending_.front());
    pending_.pop_front();
  }

  // Tells the forecast what the reports of a step say so far.
  void note_instances(const PendingStep& step) {
    for (std::size_t i = 0; i < step.batch.size(); ++i) {
      StepReport report;
      if (!reports_.read(step.number_of(i), report)) continue;
      check_can_be_sorted(report.instances);
      forecast_.note(step.batch[i], report.instances, gaussians_);
    }
  }

  void repeat_pending() {
    launcher_.wait_for_launches();
    for (const PendingStep& step : pending_) note_instances(step);
    launcher_.clear_halted_steps();
    for (PendingStep& step : pending_) step.is_launched = false;
    launch_pending();
  }

  StepLauncher& launcher_;
  Reports reports_{kMostPending};
  InstanceForecast forecast_;
  std::deque<PendingStep> pending_;
  std::size_t gaussians_ = 0;
  std::uint32_t last_photo_ = 0;
};

}  // namespace gs::cuda
