// SPDX-License-Identifier: Apache-2.0
// Longer than its class for the faults that it names: files of this form come from many programs.
#include "data_loaders/transforms/transforms_frame.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <numbers>
#include <tuple>
#include <utility>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rolling_shutter.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr int kLongestSide = 65520;          // pixels; a JPEG's most in whole blocks of 16
constexpr double kMostTime = 1e9;            // in any unit; more is a mistake
constexpr double kRotationTolerance = 0.01;  // three digits are enough; a scaled matrix is refused

/// The reason why the rows of R are not the axes of a camera; "" if they are.
std::string fault_of(const Mat3<double>& R) {
  switch (rotation_fault(R, kRotationTolerance)) {
    case RotationFault::none: return "";
    case RotationFault::scales:
      return fmt::format("scales the camera's axes by {:.4g}, {:.4g} and {:.4g}", length(R.row0),
                         length(R.row1), length(R.row2));
    case RotationFault::shears: return "shears: the camera's axes are not at right angles";
    case RotationFault::mirrors: return "mirrors: the camera's axes are left-handed";
  }
  return "";
}

/// Null stands for a key that is not there.
const SortedJson* value_of(const SortedJson& level, const char* key) {
  const auto found = level.find(key);
  return found == level.end() || found->is_null() ? nullptr : &*found;
}

/// The pose halfway between two, and the motion from the first to the last: the center goes straight,
/// and the camera turns evenly.
std::pair<FramePose, RigidMotion<double>> pose_and_motion(const FramePose& first,
                                                          const FramePose& last) {
  const Quat<double>&a = first.cam_from_world_rotation, &b = last.cam_from_world_rotation;
  const Quat<double> turn = product(b, {a.w, -a.x, -a.y, -a.z});
  const double sign = turn.w < 0 ? -1 : 1;  // of the shorter turn
  const Vec3d axis = sign * Vec3d(turn.x, turn.y, turn.z);
  const double sine = length(axis);
  RigidMotion<double> motion;
  if (sine > 0) motion.turn = 2 * std::atan2(sine, std::abs(turn.w)) / sine * axis;
  Quat<double> sum{b.w + sign * a.w, b.x + sign * a.x, b.y + sign * a.y, b.z + sign * a.z};
  const double norm = std::sqrt(squared_norm(sum));
  sum = {sum.w / norm, sum.x / norm, sum.y / norm, sum.z / norm};
  const FramePose middle{sum, 0.5 * (first.center + last.center)};
  motion.shift =
      multiply(rotation_matrix(middle.cam_from_world_rotation), last.center - first.center);
  return {middle, motion};
}

std::string kind(const SortedJson& value) {
  return fmt::format("a value of type {}", value.type_name());
}

}  // namespace

TransformsFrame::TransformsFrame(const TransformsFile& file, std::size_t index)
    : file_(file), frame_(file.frames()[index]), place_(fmt::format("frame {}", index)) {
  if (!frame_.is_object()) fail("is not an object");
  const SortedJson* path = value_of(frame_, "file_path");
  if (path && path->is_string())
    place_ += fmt::format(" ('{}')", path->get_ref<const std::string&>());
}

std::string TransformsFrame::name() const {
  const SortedJson* path = value_of(frame_, "file_path");  // not the top's
  if (!path) fail("lacks file_path");
  const auto name = path_inside(file_.folder(), text(*path, "file_path"));
  if (!name)
    fail(
        "has a file_path that is empty, absolute, a folder or leads out of the file's folder; "
        "copy the photos below that folder and name them relative to it",
        "");
  return with_extension(file_.folder(), *name);
}

fs::path TransformsFrame::mask() const {
  const SortedJson* path = value_of(frame_, "mask_path");  // not the top's
  if (!path) return {};
  const auto name = path_inside(file_.folder(), text(*path, "mask_path"));
  if (!name)
    fail(
        "has a mask_path that is empty, absolute, a folder or leads out of the file's folder; "
        "copy the masks below that folder and name them relative to it",
        "");
  const fs::path mask = file_.folder() / *name;
  std::error_code ignored;  // of a name that no file can have
  if (!fs::is_regular_file(mask, ignored))
    fail(fmt::format("names the mask {}, which is not there; copy it there, or leave mask_path out",
                     mask.string()),
         "");
  return mask;
}

fs::path TransformsFrame::depth() const {
  const SortedJson* path = value_of(frame_, "depth_file_path");
  const auto name = path && path->is_string()
                        ? path_inside(file_.folder(), text(*path, "depth_file_path"))
                        : std::nullopt;
  std::error_code ignored;
  const bool is_there = name && fs::is_regular_file(file_.folder() / *name, ignored);
  return is_there ? file_.folder() / *name : fs::path();
}

ColmapCamera TransformsFrame::camera(const std::string& name) const {
  ColmapCamera camera;
  const PhotoSize size = picture_size(name);
  camera.width = size.width;
  camera.height = size.height;
  const std::string model = model_name();
  if (model == "EQUIRECTANGULAR") {
    camera.model = CameraModel::equirectangular;
    camera.params = {double(size.width), double(size.height)};
    return camera;
  }
  const auto fx = focal_length("fl_x", "camera_angle_x", size.width);
  const auto fy = focal_length("fl_y", "camera_angle_y", size.height);
  if (!fx && !fy) fail("lacks fl_x, or camera_angle_x, and so does the top of the file");
  camera.params = {fx ? *fx : *fy, fy ? *fy : *fx, number_or("cx", 0.5 * size.width),
                   number_or("cy", 0.5 * size.height)};
  add_lens(model, camera);
  return camera;
}

void TransformsFrame::read_pose(ColmapImage& image) const {
  const bool moves =
      value_of(frame_, "transform_matrix_start") && value_of(frame_, "transform_matrix_end");
  FramePose middle = pose(moves ? "transform_matrix_start" : "transform_matrix");
  if (moves) std::tie(middle, image.motion) = pose_and_motion(middle, pose("transform_matrix_end"));
  image.cam_from_world_rotation = middle.cam_from_world_rotation;
  image.cam_from_world_translation =
      -multiply(rotation_matrix(image.cam_from_world_rotation), middle.center);
  if (!is_finite(image.cam_from_world_translation) || !is_finite(Vec3f(image.motion.shift)))
    fail("has a translation in transform_matrix that is not finite");
  if (length(image.motion.turn) > kMostShutterTurn)
    fail("turns by more than a radian from transform_matrix_start to transform_matrix_end");
  if (image.motion.is_any()) check_rolling_shutter();
}

/// instant-ngp's a + b x + c y + d t: when a pixel is exposed, from the first pose on. x and y are its
/// place, 0 to 1; t is random.
void TransformsFrame::check_rolling_shutter() const {
  const SortedJson* shutter = find("rolling_shutter");
  if (!shutter) return;
  const std::size_t count = shutter->is_array() ? shutter->size() : 0;
  bool is_by_rows = count == 3 || count == 4;
  for (std::size_t i = 0; i < count && is_by_rows; ++i)
    is_by_rows = number((*shutter)[i], "an entry of rolling_shutter") == (i == 2 ? 1 : 0);
  if (!is_by_rows)
    fail(fmt::format(
             "has {} as rolling_shutter, which must be [0, 0, 1, 0]: rows from the top down; "
             "write the poses of its first and its last row with that, or "
             "transform_matrix alone",
             shutter->dump()),
         "");
}

// cam_from_world with OpenCV's axes is the inverse of the matrix * diag(1, -1, -1, 1). The columns of
// that matrix's rotation are the camera's axes.
FramePose TransformsFrame::pose(const char* key) const {
  const SortedJson* rows = value_of(frame_, key);
  if (!rows) fail(fmt::format("lacks {}", key));
  if (!rows->is_array() || (rows->size() != 3 && rows->size() != 4)) fail_matrix(key);
  const Vec4<double> a = row((*rows)[0], key), b = row((*rows)[1], key), c = row((*rows)[2], key);
  if (rows->size() == 4 && row((*rows)[3], key) != Vec4<double>(0, 0, 0, 1))
    fail(fmt::format("has a {} whose last row is not 0 0 0 1", key));
  const Mat3<double> R{{a.x, b.x, c.x}, {-a.y, -b.y, -c.y}, {-a.z, -b.z, -c.z}};
  const std::string fault = fault_of(R);
  if (!fault.empty())
    fail(fmt::format("has a {} that {}; write it again with rotations and translations alone", key,
                     fault),
         "");
  return {quaternion_of(R), Vec3d(a.w, b.w, c.w)};
}

std::optional<double> TransformsFrame::time() const {
  const SortedJson* time = value_of(frame_, "time");
  if (!time || !time->is_number()) return std::nullopt;  // other programs' notes are no fault
  const double value = time->get<double>();
  if (!(std::abs(value) <= kMostTime)) fail("has a time beyond 1e9");
  return value;
}

void TransformsFrame::fail(const std::string& what, const char* remedy) const {
  file_.fail(fmt::format("{} {}{}", place_, what, remedy));
}

void TransformsFrame::fail_matrix(const char* key) const {
  fail(fmt::format("has a {} that is not 4 rows of 4 numbers", key));
}

/// The frame's own value, or the one at the top of the file, or nullptr.
const SortedJson* TransformsFrame::find(const char* key) const {
  const SortedJson* own = value_of(frame_, key);
  return own ? own : value_of(file_.top, key);
}

const std::string& TransformsFrame::text(const SortedJson& value, const char* key) const {
  if (!value.is_string()) fail(fmt::format("has {} as {}, not text", kind(value), key));
  return value.get_ref<const std::string&>();
}

double TransformsFrame::number(const SortedJson& value, const char* key) const {
  if (!value.is_number()) fail(fmt::format("has {} as {}, not a number", kind(value), key));
  return value.get<double>();
}

double TransformsFrame::number_or(const char* key, double otherwise) const {
  const SortedJson* value = find(key);
  return value ? number(*value, key) : otherwise;
}

Vec4<double> TransformsFrame::row(const SortedJson& value, const char* key) const {
  if (!value.is_array() || value.size() != 4) fail_matrix(key);
  const std::string entry = fmt::format("an entry of {}", key);
  const auto at = [&](int i) { return number(value[i], entry.c_str()); };
  return {at(0), at(1), at(2), at(3)};
}

// --- Intrinsics

std::string TransformsFrame::model_name() const {
  if (const SortedJson* model = find("camera_model")) return text(*model, "camera_model");
  const SortedJson* fisheye = find("is_fisheye");
  return fisheye && fisheye->is_boolean() && fisheye->get<bool>() ? "OPENCV_FISHEYE" : "OPENCV";
}

int TransformsFrame::side(double pixels, const char* key) const {
  if (!(pixels >= 1 && pixels <= kLongestSide) || pixels != std::floor(pixels))
    fail(fmt::format("has {} as {}, which must be a whole number of pixels from 1 to {}", pixels,
                     key, kLongestSide));
  return int(pixels);
}

PhotoSize TransformsFrame::picture_size(const std::string& name) const {
  const SortedJson *w = find("w"), *h = find("h");
  if (w && h) return {side(number(*w, "w"), "w"), side(number(*h, "h"), "h")};
  if (w || h) fail(fmt::format("has {} without {}", w ? "w" : "h", w ? "h" : "w"));
  PhotoSize size;
  try {
    size = read_photo_size(file_.folder() / name);
  } catch (const Error& error) {
    fail(fmt::format("lacks w and h, and its photo cannot tell them: {}", error.what()), "");
  }
  return {side(size.width, "its photo's width"), side(size.height, "its photo's height")};
}

double TransformsFrame::positive(const SortedJson& value, const char* key, double below) const {
  const double result = number(value, key);
  if (!(result > 0 && result < below))
    fail(fmt::format("has {} as {}, which must be above 0{}", result, key,
                     std::isfinite(below) ? fmt::format(" and below {:.5g}", below) : ""));
  return result;
}

/// In pixels: as it is given, or from the angle across the picture's side. The frame's own value
/// goes before the top's. Nothing if neither has any.
std::optional<double> TransformsFrame::focal_length(const char* key, const char* angle_key,
                                                    int side) const {
  for (const SortedJson* level : {&frame_, &file_.top}) {
    if (const SortedJson* pixels = value_of(*level, key)) return positive(*pixels, key, INFINITY);
    if (const SortedJson* angle = value_of(*level, angle_key)) {
      const double radians = positive(*angle, angle_key, std::numbers::pi);
      const double pixels = 0.5 * side / std::tan(0.5 * radians);
      if (!std::isfinite(pixels)) fail(fmt::format("has {} as {}: too small", radians, angle_key));
      return pixels;
    }
  }
  return std::nullopt;
}

/// Sets the model and appends the coefficients of the lens.
void TransformsFrame::add_lens(const std::string& model, ColmapCamera& camera) const {
  const auto k = [&](const char* key) { return number_or(key, 0); };
  const auto append = [&](CameraModel as, std::initializer_list<double> coefficients) {
    camera.model = as;
    camera.params.insert(camera.params.end(), coefficients);
  };
  if (model == "OPENCV_FISHEYE") {
    expect_zero(model, {"p1", "p2", "k5", "k6"});
    return append(CameraModel::opencv_fisheye, {k("k1"), k("k2"), k("k3"), k("k4")});
  }
  if (model == "PINHOLE" || model == "SIMPLE_PINHOLE") {
    expect_zero(model, {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"});
    return append(CameraModel::pinhole, {});
  }
  if (model != "OPENCV")
    fail("has the camera_model " + model +
             ", which gemsplat does not know; undistort the photos and write OPENCV, "
             "OPENCV_FISHEYE, PINHOLE, SIMPLE_PINHOLE or EQUIRECTANGULAR",
         "");
  // k4 is a coefficient of the numerator for nerfstudio and of the denominator for OpenCV.
  expect_zero(model, {"k4", "k5", "k6"});
  const double k1 = k("k1"), k2 = k("k2"), p1 = k("p1"), p2 = k("p2"), k3 = k("k3");
  if (k3 != 0) return append(CameraModel::full_opencv, {k1, k2, p1, p2, k3, 0, 0, 0});
  if (k1 != 0 || k2 != 0 || p1 != 0 || p2 != 0)
    return append(CameraModel::opencv, {k1, k2, p1, p2});
  append(CameraModel::pinhole, {});
}

void TransformsFrame::expect_zero(const std::string& model,
                                  std::initializer_list<const char*> keys) const {
  for (const char* key : keys)
    if (number_or(key, 0) != 0)
      fail(fmt::format("has {} as {}, which the camera_model {} does not have here; name the "
                       "right camera_model, or undistort the photos",
                       number_or(key, 0), key, model),
           "");
}

}  // namespace gs
