// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/lod/rad_values.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>

#include "gs_model/formats/coding/half.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"

namespace gs {
namespace {

constexpr float kPi = float(std::numbers::pi);

struct Encoding {
  std::string_view name;
  std::size_t bytes;
};
constexpr Encoding kEncodings[] = {
    {"f32", 4},      {"f16", 2}, {"f32_lebytes", 4}, {"f16_lebytes", 2}, {"r8", 1},
    {"r8_delta", 1}, {"s8", 1},  {"s8_delta", 1},    {"ln_f16", 2},      {"ln_0r8", 1}};

// Calls f(value, place): `place` counts number by number.
template <class F>
void by_number(const std::vector<float>& values, std::size_t numbers, F&& f) {
  const std::size_t count = values.size() / numbers;
  for (std::size_t d = 0; d < numbers; ++d)
    for (std::size_t i = 0; i < count; ++i) f(values[i * numbers + d], d * count + i);
}

float scale_of_byte(std::uint8_t byte, float min, float max) {
  return byte == 0 ? 0 : std::exp(min + float(byte - 1) / 254 * (max - min));
}

float sign_of(float x) { return x >= 0 ? 1.0f : -1.0f; }

}  // namespace

std::string f32_lebytes(const std::vector<float>& values, std::size_t numbers) {
  std::string bytes(4 * values.size(), '\0');
  by_number(values, numbers, [&](float value, std::size_t place) {
    const auto parts = std::bit_cast<std::array<char, 4>>(value);
    for (std::size_t b = 0; b < 4; ++b) bytes[b * values.size() + place] = parts[b];
  });
  return bytes;
}

std::string f16_planes(const std::vector<float>& values, std::size_t numbers) {
  std::string bytes;
  by_number(values, numbers,
            [&](float value, std::size_t) { append_little(bytes, to_half(value)); });
  return bytes;
}

std::string s8_planes(const std::vector<float>& values, std::size_t numbers, float max) {
  std::string bytes;
  by_number(values, numbers, [&](float value, std::size_t) {
    bytes += char(std::int8_t(std::lround(std::clamp(value / max, -1.0f, 1.0f) * 127)));
  });
  return bytes;
}

std::size_t bytes_of_encoding(std::string_view encoding) {
  for (const Encoding& known : kEncodings)
    if (known.name == encoding) return known.bytes;
  return 0;
}

std::vector<float> decoded(std::string_view encoding, std::string_view bytes, std::size_t count,
                           std::size_t numbers, float min, float max) {
  const std::size_t all = count * numbers;
  const auto byte = [&](std::size_t i) { return std::uint8_t(bytes[i]); };
  const auto whole = [&](auto type, std::size_t place) {
    using T = decltype(type);
    std::array<std::uint8_t, sizeof(T)> parts;
    for (std::size_t b = 0; b < sizeof(T); ++b)
      parts[b] =
          encoding.ends_with("_lebytes") ? byte(b * all + place) : byte(sizeof(T) * place + b);
    return std::bit_cast<T>(parts);
  };
  std::vector<float> values(all);
  for (std::size_t d = 0; d < numbers; ++d) {
    std::uint8_t sum = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t place = d * count + i;
      float& value = values[i * numbers + d];
      if (encoding.starts_with("f32")) {
        value = whole(float(), place);
      } else if (encoding.starts_with("f16")) {
        value = from_half(whole(std::uint16_t(), place));
      } else if (encoding == "ln_f16") {
        value = std::exp(from_half(whole(std::uint16_t(), place)));
      } else if (encoding == "ln_0r8") {
        value = scale_of_byte(byte(place), min, max);
      } else {
        sum = encoding.ends_with("_delta") ? std::uint8_t(sum + byte(place)) : byte(place);
        value = encoding[0] == 'r' ? min + float(sum) / 255 * (max - min)
                                   : float(std::int8_t(sum)) / 127 * max;
      }
    }
  }
  return values;
}

void append_oct88r8(std::string& to, const Quatf& q) {
  const float sign = sign_of(q.w), angle = 2 * std::acos(std::min(1.0f, std::abs(q.w)));
  const float length = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z);
  const Vec3f axis = length > 1e-6f ? Vec3f(q.x, q.y, q.z) * (sign / length) : Vec3f(1, 0, 0);
  const float sum = std::abs(axis.x) + std::abs(axis.y) + std::abs(axis.z);
  float u = axis.x / sum, v = axis.y / sum;
  if (axis.z < 0) {  // the lower half is folded outwards
    const float folded = (1 - std::abs(v)) * sign_of(u);
    v = (1 - std::abs(u)) * sign_of(v);
    u = folded;
  }
  to += char(to_unorm(0.5f + 0.5f * u, 8));
  to += char(to_unorm(0.5f + 0.5f * v, 8));
  to += char(to_unorm(angle / kPi, 8));
}

Quatf from_oct88r8(const std::uint8_t* bytes) {
  float u = 2 * from_unorm(bytes[0], 8) - 1, v = 2 * from_unorm(bytes[1], 8) - 1;
  const float z = 1 - std::abs(u) - std::abs(v), outside = std::max(0.0f, -z);
  u -= sign_of(u) * outside;
  v -= sign_of(v) * outside;
  const float half = from_unorm(bytes[2], 8) * kPi / 2;
  const float s = std::sin(half) / std::sqrt(u * u + v * v + z * z);
  return {std::cos(half), s * u, s * v, s * z};
}

}  // namespace gs
