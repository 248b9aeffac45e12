// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/frame_request.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <cmath>
#include <string_view>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"

namespace gs {
namespace {

constexpr double kRotationTolerance = 1e-3;
constexpr int kMostCameras = 1'000'000'000;
constexpr double kLargestFocal = 1e6;  // pixels

[[noreturn]] void fail(const std::string& name, const std::string& what) {
  throw UsageError(fmt::format("/frame cannot use {}: {}", name, what));
}

double number_of(std::string_view text, const std::string& name) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(float(value)))
    fail(name, fmt::format("'{}' is not a number", text.substr(0, 40)));
  return value;
}

class Parameters {
 public:
  explicit Parameters(const HttpRequest& request) : query_(request.query) {}
  bool has(const std::string& name) const { return query_.contains(name); }
  const std::string& text(const std::string& name) const {
    const auto found = query_.find(name);
    if (found == query_.end()) fail(name, "it is missing");
    return found->second;
  }
  double number(const std::string& name) const { return number_of(text(name), name); }
  int whole(const std::string& name, int most, int least = 1) const {
    const double value = number(name);
    if (!(value >= least && value <= most) || value != std::floor(value))
      fail(name, fmt::format("{} is not a whole number from {} to {}", value, least, most));
    return int(value);
  }
  float focal(const std::string& name) const {
    const double value = number(name);
    if (!(value > 0 && value <= kLargestFocal))
      fail(name, fmt::format("{} is not a focal length in pixels", value));
    return float(value);
  }

 private:
  const std::map<std::string, std::string>& query_;
};

struct Matrix {
  double m[16];
};

Matrix matrix_of(std::string_view text) {
  Matrix matrix{};
  for (int i = 0; i < 16; ++i) {
    const std::size_t comma = text.find(',');
    if ((comma == text.npos) != (i == 15))
      fail("m", "it needs 16 numbers with commas between them");
    matrix.m[i] = number_of(text.substr(0, comma), "m");
    text.remove_prefix(comma == text.npos ? text.size() : comma + 1);
  }
  return matrix;
}

// Sets the pose from the matrix world_from_camera.
void place(Camera& camera, const Matrix& matrix) {
  const double* m = matrix.m;
  const Mat3<double> R{{m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[2], m[6], m[10]}};
  if (!is_rotation(R, kRotationTolerance) || m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
    fail("m", "it is not a rotation and a position");
  camera.cam_from_world_rotation = {Vec3f(R.row0), Vec3f(R.row1), Vec3f(R.row2)};
  camera.cam_from_world_translation = Vec3f(-multiply(R, Vec3d(m[3], m[7], m[11])));
  if (!is_finite(camera.position())) fail("m", "its position is too far away");
}

float time_of(double value) {
  if (!(value >= 0 && value <= 1)) fail("t", fmt::format("{} is not a time from 0 to 1", value));
  return float(value);
}

Quantity quantity_named(const std::string& name) {
  if (name == "color") return Quantity::color;
  if (name == "depth") return Quantity::depth;
  if (name == "normal") return Quantity::normal;
  fail("mode", "it is one of color, depth and normal");
}

}  // namespace

FrameRequest frame_request_of(const HttpRequest& request) {
  const Parameters given(request);
  FrameRequest frame;
  frame.camera.width = given.whole("w", kLargestFrameSide);
  frame.camera.height = given.whole("h", kLargestFrameSide);
  frame.camera.fx = given.focal("fx");
  frame.camera.fy = given.focal("fy");
  frame.camera.cx = float(given.number("cx"));
  frame.camera.cy = float(given.number("cy"));
  place(frame.camera, matrix_of(given.text("m")));
  if (given.has("t")) frame.camera.time = time_of(given.number("t"));
  if (given.has("mode")) frame.quantity = quantity_named(given.text("mode"));
  if (given.has("look")) frame.look = std::size_t(given.whole("look", kMostCameras, 0));
  if (given.has("lens")) frame.lens = std::size_t(given.whole("lens", kMostCameras, 0));
  if (given.has("q")) frame.quality = given.whole("q", 100);
  frame.client = given.has("client") ? given.text("client") : request.client;
  return frame;
}

}  // namespace gs
