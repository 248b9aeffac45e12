// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/self_check_list.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "gs_core/math/random.h"

namespace gs {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double finite_or_infinity(double value) { return std::isfinite(value) ? value : kInfinity; }

}  // namespace

SelfCheck& SelfCheckList::check_named(const std::string& what, double tolerance) {
  for (SelfCheck& check : checks_)
    if (check.what == what) return check;
  SelfCheck& check = checks_.emplace_back();
  check.what = what;
  check.tolerance = tolerance;
  return check;
}

void SelfCheckList::add(const std::string& what, const std::string& scene, double tolerance,
                        const Numbers& actual, const Numbers& expected) {
  if (actual.size() != expected.size())
    return add(what, scene, tolerance, expected.size(), kInfinity, kInfinity);
  double largest = 0, squares = 0, expected_squares = 0;
  for (std::size_t i = 0; i < actual.size(); ++i) {
    const double difference = finite_or_infinity(std::abs(double(actual[i]) - expected[i]));
    largest = std::max(largest, difference);
    squares += difference * difference;
    expected_squares += double(expected[i]) * expected[i];
  }
  const double n = std::max(double(actual.size()), 1.0), scale = std::sqrt(expected_squares / n);
  const double unit = scale > 0 ? scale : 1;
  add(what, scene, tolerance, actual.size(), largest / unit, std::sqrt(squares / n) / unit);
}

void SelfCheckList::add(const std::string& what, const std::string& scene, double tolerance,
                        std::size_t numbers, double largest, double rms) {
  SelfCheck& check = check_named(what, tolerance);
  rms = finite_or_infinity(rms);
  if (check.scene.empty() || rms > check.rms) {
    check.rms = rms;
    check.scene = scene;
  }
  check.numbers += numbers;
  check.largest = std::max(check.largest, finite_or_infinity(largest));
}

Numbers random_normals(std::size_t count, std::uint64_t seed) {
  const Random random{seed, RandomStream::test};
  Numbers numbers(count);
  for (std::size_t i = 0; i < count; ++i) numbers[i] = random.normal4(i).x;
  return numbers;
}

}  // namespace gs
