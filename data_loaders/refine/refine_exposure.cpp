// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/refine/refine_exposure.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>

#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr double kFewestSamples = 20;  // of one photo
// Display sRGB: the difference of one point's color between well-fitted photos
// (docs/lab/2026-11-cameras.md).
constexpr double kColorNoise = 0.02;
// Of log exposures; matters only where there is little data.
constexpr double kExposureSpread = 0.5;

/// A sample as one channel sees it.
struct LogSample {
  std::uint32_t photo, point;
  double log_color;
};

/// The unknowns of one channel.
struct Channel {
  std::vector<double> log_exposure;  // (photos)
  std::vector<double> log_color;     // (points)
  // (points): display value / noise; turns log differences into those of displayed colors
  std::vector<double> weight;
  std::vector<bool> is_known;  // (points): seen in two training photos
};

/// weight (log_color - log_exposure - point's log_color)
struct ColorResidual : ceres::SizedCostFunction<1, 1, 1> {
  ColorResidual(double log_color, double weight) : log_color(log_color), weight(weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    residuals[0] = weight * (log_color - parameters[0][0] - parameters[1][0]);
    if (jacobians)
      for (int i = 0; i < 2; ++i)
        if (jacobians[i]) jacobians[i][0] = -weight;
    return true;
  }
  double log_color, weight;
};

/// log_exposure / kExposureSpread
struct ExposurePrior : ceres::SizedCostFunction<1, 1> {
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    residuals[0] = parameters[0][0] / kExposureSpread;
    if (jacobians && jacobians[0]) jacobians[0][0] = 1 / kExposureSpread;
    return true;
  }
};

/// A problem that does not own its loss functions, since two solutions share them.
ceres::Problem::Options problem_options() {
  ceres::Problem::Options options;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

/// Colors, group 0 of the ordering, are eliminated first. The caller puts blocks into the ordering.
ceres::Solver::Options solver_options() {
  ceres::Solver::Options options;
  options.linear_solver_ordering.reset(new ceres::ParameterBlockOrdering);
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  options.max_num_iterations = 100;
  options.num_threads = 1;  // sums in one order
  options.logging_type = ceres::SILENT;
  return options;
}

/// One solution from where `channel` stands. With `points_are_fixed` only exposures move.
void solve(const std::vector<LogSample>& samples, bool points_are_fixed, ceres::LossFunction* loss,
           Channel& channel) {
  ceres::Problem problem(problem_options());
  ceres::Solver::Options options = solver_options();
  const auto add_photo = [&](double* exposure) {
    if (problem.HasParameterBlock(exposure)) return;
    problem.AddResidualBlock(new ExposurePrior, nullptr, exposure);
    options.linear_solver_ordering->AddElementToGroup(exposure, 1);
  };
  for (const LogSample& sample : samples) {
    if (!channel.is_known[sample.point]) continue;
    double* exposure = &channel.log_exposure[sample.photo];
    double* color = &channel.log_color[sample.point];
    add_photo(exposure);
    problem.AddResidualBlock(new ColorResidual(sample.log_color, channel.weight[sample.point]),
                             loss, exposure, color);
    if (points_are_fixed)
      problem.SetParameterBlockConstant(color);
    else
      options.linear_solver_ordering->AddElementToGroup(color, 0);
  }
  if (problem.NumResidualBlocks() == 0) return;
  if (points_are_fixed) {
    options.linear_solver_type = ceres::DENSE_QR;
    options.linear_solver_ordering.reset();
  }
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
}

/// Points begin with the mean of their logarithms, exposures with 1.
Channel initial_channel(const std::vector<LogSample>& samples, std::size_t photos,
                        std::size_t points) {
  Channel channel;
  channel.log_exposure.assign(photos, 0);
  channel.log_color.assign(points, 0);
  std::vector<int> counts(points, 0);
  for (const LogSample& sample : samples) {
    channel.log_color[sample.point] += sample.log_color;
    ++counts[sample.point];
  }
  for (std::size_t i = 0; i < points; ++i) {
    if (counts[i]) channel.log_color[i] /= counts[i];
    channel.is_known.push_back(counts[i] >= 2);
    channel.weight.push_back(std::exp(channel.log_color[i]) / kColorNoise);
  }
  return channel;
}

Channel solve_channel(const std::vector<ColorSample>& samples, int c,
                      const std::vector<bool>& is_test, std::size_t points) {
  std::vector<LogSample> training;
  std::vector<std::vector<LogSample>> testing(is_test.size());  // by photo
  for (const ColorSample& sample : samples) {
    const LogSample value{sample.photo, sample.point, std::log(double(sample.color[c]))};
    (is_test[sample.photo] ? testing[sample.photo] : training).push_back(value);
  }
  Channel channel = initial_channel(training, is_test.size(), points);
  // The first loss is convex and comes near the solution from anywhere; the second ignores
  // outliers.
  ceres::HuberLoss convex(1);
  ceres::CauchyLoss robust(1);
  for (ceres::LossFunction* loss :
       {static_cast<ceres::LossFunction*>(&convex), static_cast<ceres::LossFunction*>(&robust)}) {
    solve(training, false, loss, channel);
    for (const std::vector<LogSample>& photo : testing) solve(photo, true, loss, channel);
  }
  return channel;
}

/// Robust standard deviation of the residuals of the logarithms, over points with two samples or
/// more.
double spread(const std::vector<ColorSample>& samples, const std::vector<Vec3f>& exposures,
              std::size_t points) {
  std::vector<Vec3d> sums(points, Vec3d(0.0));
  std::vector<int> counts(points, 0);
  const auto value = [&](const ColorSample& sample, int c) {
    return std::log(double(sample.color[c])) - std::log(double(exposures[sample.photo][c]));
  };
  for (const ColorSample& sample : samples) {
    for (int c = 0; c < 3; ++c) sums[sample.point][c] += value(sample, c);
    ++counts[sample.point];
  }
  std::vector<double> errors;
  for (const ColorSample& sample : samples) {
    const int n = counts[sample.point];
    if (n < 2) continue;
    for (int c = 0; c < 3; ++c)  // a mean of n takes 1 / n of the variance
      errors.push_back(std::abs(value(sample, c) - sums[sample.point][c] / n) *
                       std::sqrt(n / (n - 1.0)));
  }
  if (errors.empty()) return 0;
  const auto middle = errors.begin() + std::ptrdiff_t(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  constexpr double kSigmaPerMedian = 1.4826;  // of a normal distribution
  return kSigmaPerMedian * *middle;
}

/// The photos with too few samples of known points.
std::vector<std::size_t> photos_without_samples(const std::vector<ColorSample>& samples,
                                                const Channel& channel) {
  std::vector<std::size_t> counts(channel.log_exposure.size(), 0), result;
  for (const ColorSample& sample : samples) counts[sample.photo] += channel.is_known[sample.point];
  for (std::size_t i = 0; i < counts.size(); ++i)
    if (double(counts[i]) < kFewestSamples) result.push_back(i);
  return result;
}

}  // namespace

double spread_of(const std::vector<ColorSample>& samples, std::size_t photos) {
  std::size_t points = 0;
  for (const ColorSample& sample : samples)
    points = std::max(points, std::size_t(sample.point) + 1);
  return spread(samples, std::vector<Vec3f>(photos, Vec3f(1)), points);
}

bool can_refine() { return true; }
void check_can_refine(const char*) {}

ExposureFit fit_exposures(const std::vector<ColorSample>& samples,
                          const std::vector<bool>& is_test) {
  std::size_t points = 0;
  for (const ColorSample& sample : samples)
    points = std::max(points, std::size_t(sample.point) + 1);
  Channel channels[3];
  parallel_for(
      3, 1, [&](std::size_t c) { channels[c] = solve_channel(samples, int(c), is_test, points); });

  ExposureFit fit;
  fit.sample_count = samples.size();
  fit.exposures.assign(is_test.size(), Vec3f(1));
  fit.spread_before = spread(samples, fit.exposures, points);
  fit.unknown = photos_without_samples(samples, channels[0]);
  std::vector<bool> is_unknown(is_test.size(), false);
  for (const std::size_t photo : fit.unknown) is_unknown[photo] = true;
  for (int c = 0; c < 3; ++c) {
    const std::vector<double>& logs = channels[c].log_exposure;
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < logs.size(); ++i)
      if (!is_test[i] && !is_unknown[i]) sum += logs[i], ++count;
    for (std::size_t i = 0; i < logs.size(); ++i)
      if (!is_unknown[i] && count)
        fit.exposures[i][c] = float(std::exp(logs[i] - sum / double(count)));
  }
  fit.spread_after = spread(samples, fit.exposures, points);
  return fit;
}

}  // namespace gs
