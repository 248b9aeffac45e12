// SPDX-License-Identifier: Apache-2.0
#include "gs_render/paths/camera_spline.h"

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"

namespace gs {
namespace {

using Vec4d = Vec4<double>;

constexpr int kChordsPerKey = 128;  // chords that approximate the curve between two keys

double dot(const Quat<double>& a, const Quat<double>& b) {
  return a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
}

Vec4d vector_of(const Quat<double>& q) { return {q.x, q.y, q.z, q.w}; }

/// The same rotation: q or -q, whichever is in the hemisphere of `reference`.
Quat<double> on_side_of(const Quat<double>& reference, const Quat<double>& q) {
  return dot(reference, q) < 0 ? Quat<double>{-q.w, -q.x, -q.y, -q.z} : q;
}

double distance(const CameraPose& a, const CameraPose& b, double turn_length) {
  return std::hypot(length(b.position - a.position),
                    turn_length * angle_between(a.world_from_cam, b.world_from_cam));
}

/// A key with its neighbors and the intervals to them; an interval of 0 means that there is no
/// neighbor.
template <class V>
struct Knot {
  V before, here, after;
  double interval_before, interval_after;

  /// The slope of the Catmull-Rom spline; at an end that of the chord.
  V slope() const {
    const double b = interval_before, a = interval_after;
    if (b == 0) return (after - here) / a;
    if (a == 0) return (here - before) / b;
    return (a * (here - before) / b + b * (after - here) / a) / (a + b);
  }
};

/// Cubic Hermite interpolation, u from 0 to 1 over an interval of length h.
template <class V>
V between(const Knot<V>& from, const Knot<V>& to, double h, double u) {
  const double v = 1 - u;
  return (1 + 2 * u) * v * v * from.here + u * u * (3 - 2 * u) * to.here +
         h * u * v * (v * from.slope() - u * to.slope());
}

/// The keys without those that repeat the one before.
std::vector<CameraPose> distinct(const std::vector<CameraPose>& keys, bool is_closed) {
  std::vector<CameraPose> result;
  for (const CameraPose& key : keys)
    if (result.empty() || distance(result.back(), key, 1) > 0) result.push_back(key);
  while (is_closed && result.size() > 1 && distance(result.back(), result.front(), 1) == 0)
    result.pop_back();
  return result;
}

/// Chosen so that translation and rotation have the same share of the path through the keys.
double turn_length_of(const std::vector<CameraPose>& keys) {
  double moved = 0, turned = 0;
  for (std::size_t i = 1; i < keys.size(); ++i) {
    moved += length(keys[i].position - keys[i - 1].position);
    turned += angle_between(keys[i].world_from_cam, keys[i - 1].world_from_cam);
  }
  return moved > 0 && turned > 0 ? moved / turned : 1;
}

/// The times at which the curve has covered these shares of its length.
std::vector<double> evenly_paced(const CameraSpline& spline, const std::vector<double>& shares) {
  std::vector<double> times, lengths;
  for (std::size_t k = 0; k + 1 < spline.knots().size(); ++k)
    for (int i = 0; i < kChordsPerKey; ++i)
      times.push_back(spline.knots()[k] +
                      (spline.knots()[k + 1] - spline.knots()[k]) * i / kChordsPerKey);
  times.push_back(spline.end());
  CameraPose last = spline.at(0);
  double gone = 0;
  for (const double t : times) {
    const CameraPose pose = spline.at(std::min(t, std::nextafter(spline.end(), 0.0)));
    gone += distance(last, pose, spline.turn_length());
    lengths.push_back(gone);
    last = pose;
  }
  std::vector<double> result;
  for (const double share : shares) {
    const auto above = std::upper_bound(lengths.begin(), lengths.end(), share * gone);
    const std::size_t i =
        std::clamp<std::size_t>(std::size_t(above - lengths.begin()), 1, times.size() - 1);
    const double step = lengths[i] - lengths[i - 1];
    const double part = step > 0 ? std::clamp((share * gone - lengths[i - 1]) / step, 0.0, 1.0) : 0;
    result.push_back(times[i - 1] + part * (times[i] - times[i - 1]));
  }
  return result;
}

std::vector<double> paced_by_keys(const CameraSpline& spline, const std::vector<double>& shares) {
  std::vector<double> result;
  const std::vector<double>& knots = spline.knots();
  for (const double share : shares) {
    const double place = share * double(knots.size() - 1);
    const std::size_t k = std::min(std::size_t(place), knots.size() - 2);
    result.push_back(knots[k] + (place - double(k)) * (knots[k + 1] - knots[k]));
  }
  return result;
}

}  // namespace

CameraPose pose_of(const Camera& camera) {
  const PinholeCamera<double> precise = camera_as<double>(camera);
  const Mat3<double>& R = precise.cam_from_world_rotation;
  return {precise.position(), quaternion_of(Mat3<double>{{R.row0.x, R.row1.x, R.row2.x},
                                                         {R.row0.y, R.row1.y, R.row2.y},
                                                         {R.row0.z, R.row1.z, R.row2.z}})};
}

Camera with_pose(Camera camera, const CameraPose& pose) {
  const Quat<double>& q = pose.world_from_cam;
  const Mat3<double> R = rotation_matrix(Quat<double>{q.w, -q.x, -q.y, -q.z});  // cam_from_world
  camera.cam_from_world_rotation = {Vec3f(R.row0), Vec3f(R.row1), Vec3f(R.row2)};
  camera.cam_from_world_translation = Vec3f(-multiply(R, pose.position));
  return camera;
}

double angle_between(const Quat<double>& a, const Quat<double>& b) {
  const Quat<double> near = on_side_of(a, b);
  const Vec4d difference = vector_of(near) - vector_of(a);
  const double chord = std::sqrt(difference.x * difference.x + difference.y * difference.y +
                                 difference.z * difference.z + difference.w * difference.w);
  return 4 * std::asin(std::min(chord / 2, 1.0));  // exact for small angles, unlike acos
}

CameraSpline::CameraSpline(std::vector<CameraPose> keys, bool is_closed)
    : keys_(distinct(keys, is_closed)), is_closed_(is_closed && keys_.size() > 1) {
  GS_CHECK(!keys_.empty());
  turn_length_ = turn_length_of(keys_);
  knots_ = {0};
  const std::size_t intervals = is_closed_ ? keys_.size() : keys_.size() - 1;
  for (std::size_t i = 0; i < intervals; ++i)
    knots_.push_back(knots_.back() +
                     std::sqrt(distance(keys_[i], keys_[(i + 1) % keys_.size()], turn_length_)));
}

const CameraPose& CameraSpline::key(std::ptrdiff_t i) const {
  const auto count = std::ptrdiff_t(keys_.size());
  return keys_[std::size_t(is_closed_ ? (i + count) % count
                                      : std::clamp<std::ptrdiff_t>(i, 0, count - 1))];
}

double CameraSpline::interval(std::ptrdiff_t i) const {
  const auto count = std::ptrdiff_t(knots_.size()) - 1;
  if (is_closed_) i = (i + count) % count;
  return i < 0 || i >= count ? 0 : knots_[std::size_t(i) + 1] - knots_[std::size_t(i)];
}

CameraPose CameraSpline::at(double t) const {
  if (keys_.size() == 1) return keys_.front();
  if (is_closed_) t -= std::floor(t / end()) * end();
  t = std::clamp(t, 0.0, end());
  const auto above = std::upper_bound(knots_.begin(), knots_.end(), t);
  const std::ptrdiff_t i =
      std::min<std::ptrdiff_t>(above - knots_.begin(), std::ptrdiff_t(knots_.size()) - 1) - 1;
  const double h = interval(i), u = (t - knots_[std::size_t(i)]) / h;
  const CameraPose &a = key(i - 1), &b = key(i), &c = key(i + 1), &d = key(i + 2);
  const double before = interval(i - 1), after = interval(i + 1);
  const Quat<double> qb = b.world_from_cam, qa = on_side_of(qb, a.world_from_cam),
                     qc = on_side_of(qb, c.world_from_cam), qd = on_side_of(qc, d.world_from_cam);
  const Vec3d position = between(Knot<Vec3d>{a.position, b.position, c.position, before, h},
                                 Knot<Vec3d>{b.position, c.position, d.position, h, after}, h, u);
  const Vec4d q = between(Knot<Vec4d>{vector_of(qa), vector_of(qb), vector_of(qc), before, h},
                          Knot<Vec4d>{vector_of(qb), vector_of(qc), vector_of(qd), h, after}, h, u);
  const double norm = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  return {position, {q.w / norm, q.x / norm, q.y / norm, q.z / norm}};
}

std::vector<CameraPose> poses_along(const CameraSpline& spline, std::size_t count, Pace pace) {
  if (spline.end() == 0) return std::vector<CameraPose>(count, spline.at(0));
  std::vector<double> shares;
  const double steps =
      spline.is_closed() ? double(count) : double(std::max<std::size_t>(count, 2)) - 1;
  for (std::size_t i = 0; i < count; ++i) shares.push_back(double(i) / steps);
  std::vector<CameraPose> poses;
  for (const double t :
       pace == Pace::even ? evenly_paced(spline, shares) : paced_by_keys(spline, shares))
    poses.push_back(spline.at(t));
  return poses;
}

}  // namespace gs
