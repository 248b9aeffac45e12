// SPDX-License-Identifier: Apache-2.0
// Dual numbers: a scalar that carries its derivative along one direction through any formula
// (forward mode). Tests use ceres::Jet, which is not part of every build.
#pragma once

#include <cmath>

namespace gs {

/// value + slope e with e^2 = 0. Comparisons look at values alone.
struct Dual {
  double value = 0, slope = 0;

  Dual() = default;
  Dual(double value, double slope = 0) : value(value), slope(slope) {}

  Dual operator-() const { return {-value, -slope}; }
  Dual& operator+=(const Dual& b) { return *this = {value + b.value, slope + b.slope}; }
  Dual& operator-=(const Dual& b) { return *this = {value - b.value, slope - b.slope}; }
  Dual& operator*=(const Dual& b) {
    return *this = {value * b.value, slope * b.value + value * b.slope};
  }
  Dual& operator/=(const Dual& b) {
    const double quotient = value / b.value;
    return *this = {quotient, (slope - quotient * b.slope) / b.value};
  }
};

inline Dual operator+(Dual a, const Dual& b) { return a += b; }
inline Dual operator-(Dual a, const Dual& b) { return a -= b; }
inline Dual operator*(Dual a, const Dual& b) { return a *= b; }
inline Dual operator/(Dual a, const Dual& b) { return a /= b; }

inline bool operator<(const Dual& a, const Dual& b) { return a.value < b.value; }
inline bool operator>(const Dual& a, const Dual& b) { return a.value > b.value; }
inline bool operator<=(const Dual& a, const Dual& b) { return a.value <= b.value; }
inline bool operator>=(const Dual& a, const Dual& b) { return a.value >= b.value; }
inline bool operator==(const Dual& a, const Dual& b) { return a.value == b.value; }
inline bool operator!=(const Dual& a, const Dual& b) { return a.value != b.value; }

inline Dual exp(const Dual& a) {
  const double value = std::exp(a.value);
  return {value, value * a.slope};
}
inline Dual log(const Dual& a) { return {std::log(a.value), a.slope / a.value}; }
inline Dual sqrt(const Dual& a) {
  const double value = std::sqrt(a.value);
  return {value, a.slope / (2 * value)};
}
inline Dual sin(const Dual& a) { return {std::sin(a.value), std::cos(a.value) * a.slope}; }
inline Dual cos(const Dual& a) { return {std::cos(a.value), -std::sin(a.value) * a.slope}; }
inline Dual tan(const Dual& a) {
  const double value = std::tan(a.value);
  return {value, (1 + value * value) * a.slope};
}
inline Dual atan(const Dual& a) { return {std::atan(a.value), a.slope / (1 + a.value * a.value)}; }
inline Dual atan2(const Dual& y, const Dual& x) {
  return {std::atan2(y.value, x.value),
          (y.slope * x.value - y.value * x.slope) / (y.value * y.value + x.value * x.value)};
}

}  // namespace gs
