// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/refine/refine_vignetting.h"

#include <cmath>

#include "data_loaders/refine/color_problem.h"
#include "gs_core/math/photometric.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr double kLensSpread = 0.3;  // of the numbers b; matters only where there is little data

/// The unknowns of one channel.
struct Channel {
  std::vector<double> log_exposure, log_color, weight;  // (photos), (points), (points)
  std::vector<int> counts;                              // (points) samples in training photos
  std::map<std::uint32_t, std::array<double, 3>> lenses;
};

/// weight (log color - log exposure + B - point's log color)
struct LensResidual : ceres::SizedCostFunction<1, 1, 1, 3> {
  LensResidual(double log_color, double weight, double rho)
      : log_color(log_color), weight(weight), polynomials(lens_polynomials(rho)) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    double B = 0;
    for (std::size_t i = 0; i < 3; ++i) B += parameters[2][i] * polynomials[i];
    residuals[0] = weight * (log_color - parameters[0][0] + B - parameters[1][0]);
    if (!jacobians) return true;
    for (int k = 0; k < 2; ++k)
      if (jacobians[k]) jacobians[k][0] = -weight;
    for (std::size_t i = 0; jacobians[2] && i < 3; ++i) jacobians[2][i] = weight * polynomials[i];
    return true;
  }
  double log_color, weight;
  std::array<double, 3> polynomials;
};

/// Points begin with the mean of their logarithms, all else with 0.
Channel initial_channel(const std::vector<ColorSample>& training, int c, std::size_t photos) {
  Channel channel;
  channel.log_exposure.assign(photos, 0);
  for (const ColorSample& sample : training) {
    const std::size_t point = sample.point;
    if (channel.counts.size() <= point) {
      channel.counts.resize(point + 1, 0);
      channel.log_color.resize(point + 1, 0);
    }
    channel.log_color[point] += std::log(double(sample.color[c]));
    ++channel.counts[point];
    channel.lenses[sample.camera] = {0, 0, 0};
  }
  for (std::size_t i = 0; i < channel.counts.size(); ++i) {
    if (channel.counts[i]) channel.log_color[i] /= channel.counts[i];
    channel.weight.push_back(std::exp(channel.log_color[i]) / kColorNoise);
  }
  return channel;
}

void solve(const std::vector<ColorSample>& training, int c, ceres::LossFunction* loss,
           Channel& channel) {
  ceres::Problem problem(color_problem_options());
  ceres::Solver::Options options = color_solver_options();
  const auto add = [&](double* block, ceres::CostFunction* prior) {
    problem.AddResidualBlock(prior, nullptr, block);
    options.linear_solver_ordering->AddElementToGroup(block, 1);
  };
  for (auto& [id, lens] : channel.lenses) add(lens.data(), new Prior<3>(kLensSpread));
  for (const ColorSample& sample : training) {
    if (channel.counts[sample.point] < 2) continue;
    double* const exposure = &channel.log_exposure[sample.photo];
    double* const color = &channel.log_color[sample.point];
    if (!problem.HasParameterBlock(exposure)) add(exposure, new Prior<1>(kExposureSpread));
    problem.AddResidualBlock(new LensResidual(std::log(double(sample.color[c])),
                                              channel.weight[sample.point], double(sample.rho)),
                             loss, exposure, color, channel.lenses[sample.camera].data());
    options.linear_solver_ordering->AddElementToGroup(color, 0);
  }
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
}

bool is_darker_at_corners(const std::array<float, 3>& b) {
  return log_vignetting(b, 1.0f) > log_vignetting(b, 0.0f);
}

}  // namespace

Lenses fit_vignetting(const std::vector<ColorSample>& samples, const std::vector<bool>& is_test) {
  std::vector<ColorSample> training;
  for (const ColorSample& sample : samples)
    if (!is_test[sample.photo]) training.push_back(sample);
  Channel channels[3];
  parallel_for(3, 1, [&](std::size_t c) {
    Channel& channel = channels[c] = initial_channel(training, int(c), is_test.size());
    // As in fit_exposures(): the first loss finds the place, the second ignores outliers.
    ceres::HuberLoss convex(1);
    ceres::CauchyLoss robust(1);
    solve(training, int(c), &convex, channel);
    solve(training, int(c), &robust, channel);
  });
  Lenses lenses;
  for (const auto& [id, lens] : channels[0].lenses) {
    std::array<float, 3>& mean = lenses[id];
    for (std::size_t i = 0; i < 3; ++i)
      mean[i] = float((lens[i] + channels[1].lenses[id][i] + channels[2].lenses[id][i]) / 3);
    if (!is_darker_at_corners(mean)) mean = {0, 0, 0};
  }
  return lenses;
}

std::vector<ColorSample> without_vignetting(std::vector<ColorSample> samples,
                                            const Lenses& lenses) {
  for (ColorSample& sample : samples)
    if (const auto lens = lenses.find(sample.camera); lens != lenses.end())
      sample.color = gained(1.0f, log_vignetting(lens->second, sample.rho), 0.0f) * sample.color;
  return samples;
}

}  // namespace gs
