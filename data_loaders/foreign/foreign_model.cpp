// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/foreign/foreign_model.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/photos/photo_names.h"
#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/ascii.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr double kMostPixels = 1e6;          // of a side, and of a focal length times a thousand
constexpr double kRotationTolerance = 0.01;  // three digits are enough

/// The ends of a path at its slashes, the longest first: a/b.jpg, b.jpg.
std::vector<std::string> ends_of(const std::string& path) {
  std::vector<std::string> ends = {path};
  for (std::size_t slash = path.find('/'); slash != path.npos; slash = path.find('/', slash + 1))
    ends.push_back(path.substr(slash + 1));
  return ends;
}

}  // namespace

ForeignModel::ForeignModel(fs::path file, fs::path photos)
    : file_(std::move(file)), photos_(std::move(photos)) {
  for (const std::string& name : picture_names_in(photos_))
    for (const std::string& end : ends_of(name)) {
      names_[lowercase(end)].push_back(name);
      if (const std::string stem = without_extension(end); stem != end)
        names_[lowercase(stem)].push_back(name);
    }
}

void ForeignModel::fail(const std::string& what) const { cannot_read(file_, what); }

std::optional<std::string> ForeignModel::photo(const std::string& label) {
  std::string path = lowercase(label);
  std::replace(path.begin(), path.end(), '\\', '/');
  for (const std::string& end : ends_of(path)) {
    const auto found = names_.find(end);
    if (found == names_.end()) continue;
    if (found->second.size() > 1)
      fail(
          fmt::format("its photo '{}' could be {} or {} in {}; name the folder of the right photos "
                      "with --set dataset.images=FOLDER",
                      label, found->second[0], found->second[1], photos_.string()));
    return found->second[0];
  }
  missing_.push_back(label);
  return std::nullopt;
}

std::optional<std::string> ForeignModel::photo_at(const std::string& end) const {
  const auto found = names_.find(lowercase(end));
  if (found == names_.end() || found->second.size() != 1) return std::nullopt;
  return found->second[0];
}

PhotoSize ForeignModel::size_of(const std::string& photo) const {
  return read_photo_size(photos_ / photo);
}

std::uint32_t ForeignModel::camera(CameraModel model, PhotoSize size, std::vector<double> params) {
  const auto is_good = [](double value) { return std::isfinite(value) && std::abs(value) < 1e9; };
  const bool has_focal_length = model == CameraModel::equirectangular || params.at(0) > 0;
  if (size.width < 1 || size.height < 1 || size.width > kMostPixels || size.height > kMostPixels ||
      !has_focal_length || !std::all_of(params.begin(), params.end(), is_good))
    fail(fmt::format("a camera of {}x{} pixels has parameters that none can have; export it again",
                     size.width, size.height));
  const auto [known, is_new] = cameras_.try_emplace({int(model), size.width, size.height, params},
                                                    std::uint32_t(cameras_.size() + 1));
  const std::uint32_t id = known->second;
  if (is_new) model_.cameras[id] = {id, model, size.width, size.height, std::move(params)};
  return id;
}

std::uint32_t ForeignModel::camera(PhotoSize size, const BrownLens& l) {
  if (l.k4 != 0)
    fail(
        "a camera has a coefficient k4 of r^8, which no lens of gemsplat has; export the photos "
        "undistorted, with their cameras");
  if (l.k3 != 0)
    return camera(CameraModel::full_opencv, size,
                  {l.fx, l.fy, l.cx, l.cy, l.k1, l.k2, l.p1, l.p2, l.k3, 0, 0, 0});
  if (l.k1 != 0 || l.k2 != 0 || l.p1 != 0 || l.p2 != 0)
    return camera(CameraModel::opencv, size, {l.fx, l.fy, l.cx, l.cy, l.k1, l.k2, l.p1, l.p2});
  return camera(CameraModel::pinhole, size, {l.fx, l.fy, l.cx, l.cy});
}

void ForeignModel::add(const std::string& photo, std::uint32_t camera, const Mat3<double>& R,
                       const Vec3d& t, bool looks_back) {
  const double back = looks_back ? -1 : 1;
  const Mat3<double> rows{R.row0, back * R.row1, back * R.row2};
  if (!is_rotation(rows, kRotationTolerance) || !is_finite(t))
    fail(
        fmt::format("the pose of '{}' is not one: its axes are not at right angles, or of other "
                    "lengths than 1; export it again",
                    photo));
  if (!added_.try_emplace(photo, model_.images.size()).second)
    fail(fmt::format("two poses belong to the photo {}; leave one out", photo));
  ColmapImage& image = model_.images.emplace_back();
  image.id = std::uint32_t(model_.images.size());
  image.name = photo;
  image.camera_id = camera;
  image.cam_from_world_rotation = quaternion_of(rows);
  image.cam_from_world_translation = {t.x, back * t.y, back * t.z};
}

void ForeignModel::add_at(const std::string& photo, std::uint32_t camera,
                          const Mat3<double>& world_from_cam, const Vec3d& center,
                          bool looks_back) {
  const Mat3<double> R = transposed(world_from_cam);
  add(photo, camera, R, -multiply(R, center), looks_back);
}

void ForeignModel::add_point(const Vec3d& position, const Vec3d& color) {
  if (!is_finite(position) || !is_finite(color)) return;
  const auto byte = [](double value) { return std::uint8_t(std::clamp(value + 0.5, 0.0, 255.0)); };
  model_.points.push_back(
      {model_.points.size() + 1, position, {byte(color.x), byte(color.y), byte(color.z)}});
}

ColmapModel ForeignModel::take() {
  if (model_.images.empty())
    fail(
        missing_.empty()
            ? "it has no photo with a pose; align the photos first"
            : fmt::format("none of its {} photos, such as '{}', is in {}; copy them there, or name "
                          "their folder with --set dataset.images=FOLDER",
                          missing_.size(), missing_[0], photos_.string()));
  if (!missing_.empty())
    log_warning("{} poses of {} have no photo in {}, such as '{}': left out", missing_.size(),
                file_.string(), photos_.string(), missing_[0]);
  model_.folder = file_;
  return std::move(model_);
}

// --- JSON

const SortedJson& ForeignJson::at(const SortedJson& object, const char* key) const {
  if (object.is_object())
    if (const auto found = object.find(key); found != object.end() && !found->is_null())
      return *found;
  model_.fail(fmt::format("it lacks '{}' where one belongs; export it again", key));
}

const SortedJson& ForeignJson::list(const SortedJson& object, const char* key) const {
  static const SortedJson none = SortedJson::array();
  const auto found = object.is_object() ? object.find(key) : object.end();
  return !object.is_object() || found == object.end() ? none : *found;
}

double ForeignJson::number(const SortedJson& value, const char* key) const {
  double result = 0;
  if (value.is_number()) return value.get<double>();
  if (value.is_string() && parse_number(value.get_ref<const std::string&>(), result)) return result;
  model_.fail(fmt::format("'{}' is no number; export it again", key));
}

double ForeignJson::number_at(const SortedJson& object, const char* key) const {
  return number(at(object, key), key);
}

double ForeignJson::number_or(const SortedJson& object, const char* key, double otherwise) const {
  const auto found = object.find(key);
  return found == object.end() || found->is_null() ? otherwise : number(*found, key);
}

PhotoSize ForeignJson::size_at(const SortedJson& object, const char* width,
                               const char* height) const {
  const double w = number_at(object, width), h = number_at(object, height);
  if (!(w >= 1 && h >= 1 && w <= kMostPixels && h <= kMostPixels))
    model_.fail(fmt::format("a picture has {} x {} pixels; export it again", w, h));
  return {int(w), int(h)};
}

std::vector<double> ForeignJson::numbers(const SortedJson& value, const char* key,
                                         std::size_t count) const {
  if (!value.is_array() || value.size() != count)
    model_.fail(fmt::format("'{}' is no list of {} numbers; export it again", key, count));
  std::vector<double> result;
  for (const SortedJson& element : value) result.push_back(number(element, key));
  return result;
}

Vec3d ForeignJson::vector_at(const SortedJson& object, const char* key) const {
  const std::vector<double> v = numbers(at(object, key), key, 3);
  return {v[0], v[1], v[2]};
}

std::string ForeignJson::text_at(const SortedJson& object, const char* key) const {
  const SortedJson& value = at(object, key);
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number_integer()) return value.dump();
  model_.fail(fmt::format("'{}' is no text; export it again", key));
}

Mat3<double> matrix_of_rows(const std::vector<double>& n) {
  return {{n[0], n[1], n[2]}, {n[3], n[4], n[5]}, {n[6], n[7], n[8]}};
}

Mat3<double> transposed(const Mat3<double>& m) {
  return {{m.row0.x, m.row1.x, m.row2.x},
          {m.row0.y, m.row1.y, m.row2.y},
          {m.row0.z, m.row1.z, m.row2.z}};
}

}  // namespace gs
