// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checkpoints/checkpoint_views.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

namespace gs {
namespace {

struct ViewNumbers {
  std::int32_t is_test, width, height;
  float fx, fy, cx, cy;
  Mat3<float> rotation;
  Vec3f translation, exposure;
};
static_assert(sizeof(ViewNumbers) == 22 * 4);

ViewNumbers numbers_of(const ViewRecord& view) {
  const Camera& camera = view.camera;
  return {view.is_test,
          camera.width,
          camera.height,
          camera.fx,
          camera.fy,
          camera.cx,
          camera.cy,
          camera.cam_from_world_rotation,
          camera.cam_from_world_translation,
          view.exposure};
}

ViewRecord view_of(const ViewNumbers& numbers) {
  ViewRecord view;
  view.is_test = numbers.is_test != 0;
  view.exposure = numbers.exposure;
  Camera& camera = view.camera;
  camera.width = numbers.width;
  camera.height = numbers.height;
  camera.fx = numbers.fx;
  camera.fy = numbers.fy;
  camera.cx = numbers.cx;
  camera.cy = numbers.cy;
  camera.cam_from_world_rotation = numbers.rotation;
  camera.cam_from_world_translation = numbers.translation;
  return view;
}

// Numbers of a lens in a file: without its motion, and with it, if any view has one.
constexpr std::size_t kLensNumbers = 21, kMovingLensNumbers = 29;
static_assert(sizeof(CameraLens<float>) == kMovingLensNumbers * sizeof(float));

bool is_sound(const CameraLens<float>& lens) {
  float sum = lens.radius + lens.low.x + lens.low.y + lens.high.x + lens.high.y;
  for (const float number : lens.k) sum += number;
  for (const float number : lens.d) sum += number;
  for (const float number : lens.p) sum += number;
  for (const float number : lens.s) sum += number;
  return std::isfinite(sum) && is_finite(lens.motion.turn) && is_finite(lens.motion.shift) &&
         std::isfinite(lens.rows.x) && (!lens.motion.is_any() || lens.rows.x < lens.rows.y) &&
         std::isfinite(lens.rows.y) && lens.lens >= Lens::none && lens.lens <= Lens::unified;
}

}  // namespace

void write_views(CheckedWriter& file, const std::vector<ViewRecord>& views) {
  std::string names;
  for (const ViewRecord& view : views) names += view.name + '\0';
  file.text("view_names", names);
  file.section("views", views.size() * sizeof(ViewNumbers));
  for (const ViewRecord& view : views) {
    const ViewNumbers numbers = numbers_of(view);
    file.write(&numbers, sizeof numbers);
  }
}

std::vector<ViewRecord> read_views(CheckedReader& file) {
  const std::string names = file.text("view_names");
  std::vector<ViewRecord> views;
  std::size_t begin = 0;
  for (const ViewNumbers& numbers : file.values<ViewNumbers>("views")) {
    const std::size_t end = names.find('\0', begin);
    if (end == names.npos) file.damaged();
    views.push_back(view_of(numbers));
    views.back().name = names.substr(begin, end - begin);
    begin = end + 1;
  }
  return views;
}

void write_times(CheckedWriter& file, const std::vector<ViewRecord>& views) {
  file.section("view_times", views.size() * sizeof(float));
  for (const ViewRecord& view : views) file.write(&view.camera.time, sizeof view.camera.time);
}

void read_times(CheckedReader& file, std::vector<ViewRecord>& views) {
  const std::vector<float> times = file.values<float>("view_times");
  if (times.size() != views.size()) file.damaged();
  for (std::size_t i = 0; i < views.size(); ++i) views[i].camera.time = times[i];
}

bool have_lenses(const std::vector<ViewRecord>& views) {
  return std::any_of(views.begin(), views.end(),
                     [](const ViewRecord& view) { return view.camera.has_lens(); });
}

void write_lenses(CheckedWriter& file, const std::vector<ViewRecord>& views) {
  const bool move = std::any_of(views.begin(), views.end(), [](const ViewRecord& view) {
    return view.camera.has_rolling_shutter();
  });
  const std::size_t bytes = (move ? kMovingLensNumbers : kLensNumbers) * sizeof(float);
  file.section("view_lenses", views.size() * bytes);
  for (const ViewRecord& view : views) file.write(&view.camera.lens, bytes);
}

void read_lenses(CheckedReader& file, std::vector<ViewRecord>& views) {
  const auto numbers = file.values<float>("view_lenses");
  const std::size_t each = numbers.size() / std::max<std::size_t>(views.size(), 1);
  if (each * views.size() != numbers.size() || (each != kLensNumbers && each != kMovingLensNumbers))
    file.damaged();
  for (std::size_t i = 0; i < views.size(); ++i)
    std::memcpy(static_cast<void*>(&views[i].camera.lens), &numbers[each * i],
                each * sizeof(float));
}

bool is_sound(const ViewRecord& view) {
  const Camera& camera = view.camera;
  const Mat3<float>& R = camera.cam_from_world_rotation;
  constexpr int kLargestSide = 1 << 20;  // pixels, as for cameras.json
  const auto is_side = [](int pixels) { return pixels > 0 && pixels <= kLargestSide; };
  return is_side(camera.width) && is_side(camera.height) && camera.fx > 0 && camera.fy > 0 &&
         is_finite(Vec3f(camera.fx, camera.fy, 0)) && is_finite(Vec3f(camera.cx, camera.cy, 0)) &&
         is_finite(R.row0) && is_finite(R.row1) && is_finite(R.row2) &&
         is_finite(camera.cam_from_world_translation) && is_finite(view.exposure) &&
         std::isfinite(camera.time) && is_sound(camera.lens);
}

}  // namespace gs
