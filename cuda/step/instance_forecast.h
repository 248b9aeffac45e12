// SPDX-License-Identifier: Apache-2.0
// How much room the instances of a photo need in a step of training, before they are counted.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <unordered_map>

#include "gs_core/forecast/gpu_step.h"
#include "gs_train/backend.h"

namespace gs::cuda {

inline constexpr double kGrowthMargin = 1.2;    // times the instances of a view's last visit
inline constexpr double kMostPerGaussian = 16;  // that a higher resolution may be expected to need
inline constexpr std::size_t kCapacityStep = std::size_t(1) << 14;  // capacities are multiples

/// Forecasts how many instances a view will have. Where its last visit was at a lower resolution, it
/// has more of them now: as many times as there are more pixels, at most.
class InstanceForecast {
 public:
  void note(const TrainingPhoto& photo, std::size_t instances, std::size_t gaussians) {
    gaussians = std::max<std::size_t>(gaussians, 1);
    visits_[photo.view] = {instances, gaussians, photo.reduction};
    double& most = most_per_gaussian_[photo.reduction];
    most = std::max(most, double(instances) / double(gaussians));
  }
  bool has_seen(const View& view) const { return visits_.contains(&view); }
  std::uint32_t capacity_for(const TrainingPhoto& photo, std::size_t gaussians) const {
    const double limit = std::max(double(kLeastCapacity), kMostPerGaussian * double(gaussians));
    double capacity = first_capacity(gaussians);
    if (const auto visit = visits_.find(photo.view); visit != visits_.end()) {
      const double growth = double(gaussians) / double(visit->second.gaussians);
      capacity = double(visit->second.instances) * std::max(growth, 1.0) * kGrowthMargin;
      capacity = enlarged(capacity, visit->second.reduction, photo.reduction, limit);
    } else {
      double most = 0;
      for (const auto& [reduction, of_one] : most_per_gaussian_)
        most = std::max(most, enlarged(of_one * double(gaussians) * unseen_margin(gaussians),
                                       reduction, photo.reduction, limit));
      if (most > 0) capacity = most;
    }
    const double steps = std::min(std::ceil(capacity / double(kCapacityStep)),
                                  0x7fffffff / double(kCapacityStep) - 1);
    return std::uint32_t((std::size_t(steps) + 1) * kCapacityStep);
  }
  void forget() { *this = {}; }

 private:
  struct Visit {
    std::size_t instances, gaussians;
    int reduction;
  };

  // A number of instances at a reduction becomes one at a lower reduction: up to `most` if it was
  // not above that already.
  static double enlarged(double instances, int from, int to, double most) {
    const double ratio = double(from) / double(to);
    return ratio > 1 ? std::max(instances, std::min(instances * ratio * ratio, most)) : instances;
  }

  std::unordered_map<const View*, Visit> visits_;
  std::unordered_map<int, double> most_per_gaussian_;  // by reduction
};

}  // namespace gs::cuda
