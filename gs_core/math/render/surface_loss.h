// SPDX-License-Identifier: Apache-2.0
// Stage 5 for surfaces: what a picture of inverse depths and normals is compared with. Blending has
// left sums over the fragments of each pixel (SurfaceRow); o is their mean inverse depth, N the sum
// of their normals. docs/method/surfaces.md explains the choices.
//
//   normal   1 - N^ . n_d     n_d is the normal of the inverse depths around the pixel
//   photo    1 - q            q is the squared correlation of a patch with a neighboring photo, into
//                             which the plane of o and N^ takes it   (Furukawa & Ponce 2010; PGSR)
//   prior    1 - N^ . n_p     n_p is the normal of a map that somebody has given
#pragma once

#include "gs_core/math/render/normal_map.h"
#include "gs_core/math/render/surface.h"

namespace gs {

inline constexpr float kLeastCoverage = 0.55f;  // of a pixel with a surface
inline constexpr float kMostJump = 0.1f;  // of the inverse depth, between pixels of one surface
inline constexpr float kLeastNormal = 1e-12f;  // squared length of N
inline constexpr int kPatchRadius = 3;         // pixels; a patch has 7x7
inline constexpr int kPatchStride = 4;  // pixels from one patch of a step to the next, both ways
inline constexpr float kLeastCosine = 0.1f;   // between a patch's ray and normal
inline constexpr float kMostMismatch = 0.9f;  // a patch that fits less is hidden, or glitters
inline constexpr float kLeastGrayVariance =
    5e-6f;  // of a patch's gray values; smoother ones say nothing

/// How much of the loss the terms are; zeros: none.
struct SurfaceWeights {
  float normal = 0, photo = 0, prior = 0;

  GS_HD bool any() const { return normal > 0 || photo > 0 || prior > 0; }
};

/// The surface that a pixel shows. As a gradient, dL by each.
template <class T>
struct PixelSurface {
  T o{0};                            // inverse depth   1 / world units
  Vec2<T> slope{T(0), T(0)};         // its change by the pixel
  Vec3<T> normal{T(0), T(0), T(0)};  // N, of any length; camera axes
};

/// From the principal point to the center of a pixel.
GS_HD Vec2f from_axis(const Camera& camera, int x, int y) {
  return {float(x) + 0.5f - camera.cx, float(y) + 0.5f - camera.cy};
}

/// The mean inverse depth of a pixel; 0: it shows no surface.
GS_HD float mean_inverse_depth(const SurfaceRow& sums, const Vec2f& x) {
  if (!(sums.coverage >= kLeastCoverage)) return 0;
  const float o = (sums.of.at_axis + inner(sums.of.slope, x)) / sums.coverage;
  return o > 0 && o - o == 0 ? o : 0;
}
/// Gradients of o = mean_inverse_depth() > 0, and of N, which is one of the sums.
GS_HD SurfaceRow pixel_sums_vjp(const SurfaceRow& sums, const Vec2f& x, float o, float dL_do,
                                const Vec3f& dL_dnormal) {
  const float by_sum = dL_do / sums.coverage;
  return {{by_sum, x * by_sum, dL_dnormal}, -o * by_sum};
}

// ---- normals -----------------------------------------------------------------------------------

/// The normal of a plane whose inverse depth has this value and slope, of any length, towards the
/// camera. Exact, since the inverse depth of a plane is affine in the pixel:
///
///   m = -(fx ox, fy oy, o - x . slope)
template <class T>
GS_HD Vec3<T> plane_normal(const PinholeCamera<T>& camera, const Vec2<T>& x, const T& o,
                           const Vec2<T>& slope) {
  return {-camera.fx * slope.x, -camera.fy * slope.y, inner(slope, x) - o};
}

/// 1 - N^ . n_d
template <class T>
GS_HD T normal_error(const PinholeCamera<T>& camera, const Vec2<T>& x, const PixelSurface<T>& at) {
  using std::sqrt;
  const Vec3<T> m = plane_normal(camera, x, at.o, at.slope);
  return T(1) - inner(at.normal, m) / sqrt(inner(at.normal, at.normal) * inner(m, m));
}
template <class T>
GS_HD PixelSurface<T> normal_error_vjp(const PinholeCamera<T>& camera, const Vec2<T>& x,
                                       const PixelSurface<T>& at, const T& dL) {
  using std::sqrt;
  const Vec3<T> m = plane_normal(camera, x, at.o, at.slope);
  const T length = sqrt(inner(at.normal, at.normal)), length_m = sqrt(inner(m, m));
  const Vec3<T> N = at.normal / length, n = m / length_m;
  const T cosine = inner(N, n);
  const Vec3<T> M = (N - n * cosine) * (-dL / length_m);  // dL/dm
  return {-M.z,
          {x.x * M.z - camera.fx * M.x, x.y * M.z - camera.fy * M.y},
          (n - N * cosine) * (-dL / length)};
}

/// 1 - N^ . prior, where the prior is a constant of any length.
template <class T>
GS_HD T prior_error(const Vec3<T>& normal, const Vec3<T>& prior) {
  using std::sqrt;
  return T(1) - inner(normal, prior) / sqrt(inner(normal, normal));
}
template <class T>
GS_HD Vec3<T> prior_error_vjp(const Vec3<T>& normal, const Vec3<T>& prior, const T& dL) {
  using std::sqrt;
  const T length = sqrt(inner(normal, normal));
  const Vec3<T> N = normal / length;
  return (prior - N * inner(N, prior)) * (-dL / length);
}

// ---- photos ------------------------------------------------------------------------------------

/// A camera as another one sees it: Y = R X + t takes points from the axes of that one to its own.
template <class T>
struct NeighborCamera {
  Mat3<T> R;
  Vec3<T> t;  // world units
  T fx, fy, cx, cy;
};
template <class T>
GS_HD NeighborCamera<T> seen_from(const PinholeCamera<T>& camera,
                                  const PinholeCamera<T>& neighbor) {
  const Mat3<T>&W = camera.cam_from_world_rotation, &V = neighbor.cam_from_world_rotation;
  const Mat3<T> R{multiply(W, V.row0), multiply(W, V.row1), multiply(W, V.row2)};
  return {R,
          neighbor.cam_from_world_translation - multiply(R, camera.cam_from_world_translation),
          neighbor.fx,
          neighbor.fy,
          neighbor.cx,
          neighbor.cy};
}

/// A gray photo. Values are 0 to 1, and below 0 where the photo's mask leaves a pixel out.
struct GrayPhoto {
  const float* values;  // (height, width)
  int width, height;

  GS_HD float at(int x, int y) const { return values[std::size_t(y) * std::size_t(width) + x]; }
};
GS_HD float gray_of(const std::uint8_t* rgb, const std::uint8_t* mask) {
  if (mask && *mask < 128) return -1;
  return (0.299f * float(rgb[0]) + 0.587f * float(rgb[1]) + 0.114f * float(rgb[2])) / 255.0f;
}

/// The value of a photo between four pixels, and its change; false where it has none.
template <class T>
struct GraySample {
  bool is_known = false;
  T value{};
  Vec2<T> slope{};
};
template <class T>
GS_HD GraySample<T> sample(const GrayPhoto& photo, const Vec2<T>& pixel) {
  using std::floor;
  const T left = floor(pixel.x - T(0.5)), top = floor(pixel.y - T(0.5));
  if (!(left >= T(0) && top >= T(0) && left < T(photo.width - 1) && top < T(photo.height - 1)))
    return {};
  const int x = int(left), y = int(top);
  const T u = pixel.x - T(0.5) - left, v = pixel.y - T(0.5) - top;
  const T a = T(photo.at(x, y)), b = T(photo.at(x + 1, y)), c = T(photo.at(x, y + 1)),
          d = T(photo.at(x + 1, y + 1));
  if (a < T(0) || b < T(0) || c < T(0) || d < T(0)) return {};
  const T upper = a + u * (b - a), lower = c + u * (d - c);
  return {true, upper + v * (lower - upper), {(b - a) + v * ((d - c) - (b - a)), lower - upper}};
}

/// How a patch fits the neighboring photo, and the gradients by o and N.
template <class T>
struct PhotoMismatch {
  bool is_known = false;  // false: the patch says nothing
  T error{};              // 1 - q
  T by_o{};
  Vec3<T> by_normal{T(0), T(0), T(0)};
};

/// Compares the patch around pixel (x, y) with a neighboring photo.
///
///   u: the pixel's ray (z = 1), u' those of the patch, n = N^, B = o (n . u') / (n . u)
///   Y = R u' + B t,   r and s: the gray values of the patch, and of the neighbor at the pixel of Y
///   C = sum r s - sum r sum s / M,   V alike,   q = C^2 / (V_r V_s + 1e-8)
///
/// q does not change with the gain and the offset of either photo. With t_i = dq/ds_i ds_i/dB_i,
///
///   S = sum t_i u'_i:   dq/do = (n . S) / (n . u),   dq/dn = o S / (n . u) - o (n . S) u / (n . u)^2
///
/// dq/ds_i is affine in r_i and s_i, so that one walk over the patch has the sums of all.
template <class T>
GS_HD PhotoMismatch<T> photo_mismatch(const PinholeCamera<T>& camera,
                                      const NeighborCamera<T>& neighbor, int x, int y,
                                      const PixelSurface<T>& at, const GrayPhoto& photo,
                                      const GrayPhoto& other) {
  using std::sqrt;
  if (x < kPatchRadius || y < kPatchRadius || x >= photo.width - kPatchRadius ||
      y >= photo.height - kPatchRadius)
    return {};
  const T length = sqrt(inner(at.normal, at.normal));
  const Vec3<T> n = at.normal / length;
  const Vec3<T> u{(T(x) + T(0.5) - camera.cx) / camera.fx, (T(y) + T(0.5) - camera.cy) / camera.fy,
                  T(1)};
  const T n_u = inner(n, u);
  if (!(n_u < T(-kLeastCosine) * sqrt(inner(u, u)))) return {};

  // Sums of {1, r, s} and their products; and of {1, r, s} times dB -> s times {1, dx, dy}. Values
  // are taken from those of the middle, which changes neither C nor V and spares digits.
  const T middle = T(photo.at(x, y));
  T sum_r(0), sum_s(0), sum_rr(0), sum_rs(0), sum_ss(0);
  T moments[3][3] = {};
  const Vec3<T> center = multiply(neighbor.R, u);
  for (int dy = -kPatchRadius; dy <= kPatchRadius; ++dy)
    for (int dx = -kPatchRadius; dx <= kPatchRadius; ++dx) {
      const T gray = T(photo.at(x + dx, y + dy));
      if (gray < T(0)) return {};
      const T ux = T(dx) / camera.fx, uy = T(dy) / camera.fy;
      const T B = at.o * (T(1) + (n.x * ux + n.y * uy) / n_u);
      const Vec3<T>&R0 = neighbor.R.row0, &R1 = neighbor.R.row1, &R2 = neighbor.R.row2;
      const Vec3<T> Y{center.x + R0.x * ux + R0.y * uy + B * neighbor.t.x,
                      center.y + R1.x * ux + R1.y * uy + B * neighbor.t.y,
                      center.z + R2.x * ux + R2.y * uy + B * neighbor.t.z};
      if (!(B > T(0) && Y.z > T(1e-6))) return {};
      const T px = Y.x / Y.z, py = Y.y / Y.z;
      const GraySample<T> there =
          sample(other, Vec2<T>{neighbor.fx * px + neighbor.cx, neighbor.fy * py + neighbor.cy});
      if (!there.is_known) return {};
      const T by_B = (there.slope.x * neighbor.fx * (neighbor.t.x - px * neighbor.t.z) +
                      there.slope.y * neighbor.fy * (neighbor.t.y - py * neighbor.t.z)) /
                     Y.z;
      const T r = gray - middle, s = there.value - middle;
      sum_r += r, sum_s += s;
      sum_rr += r * r, sum_rs += r * s, sum_ss += s * s;
      const T of[3] = {by_B, by_B * r, by_B * s};
      for (int k = 0; k < 3; ++k) {
        moments[k][0] += of[k];
        moments[k][1] += of[k] * ux;
        moments[k][2] += of[k] * uy;
      }
    }
  constexpr int kSamples = (2 * kPatchRadius + 1) * (2 * kPatchRadius + 1);
  const T inverse = T(1) / T(kSamples);
  const T C = sum_rs - sum_r * sum_s * inverse, V_r = sum_rr - sum_r * sum_r * inverse,
          V_s = sum_ss - sum_s * sum_s * inverse;
  const T least = T(kSamples * kLeastGrayVariance);
  if (!(C > T(0)) || !(V_r > least) || !(V_s > least)) return {};
  const T D = V_r * V_s + T(1e-8), q = C * C / D;
  if (!(T(1) - q < T(kMostMismatch))) return {};

  // dq/ds = by_r r + by_s s + by_1
  const T by_r = T(2) * C / D, by_s = T(-2) * q * V_r / D;
  const T by_1 = -(by_r * sum_r + by_s * sum_s) * inverse;
  T t[3];
  for (int k = 0; k < 3; ++k)
    t[k] = by_1 * moments[0][k] + by_r * moments[1][k] + by_s * moments[2][k];
  const Vec3<T> S = u * t[0] + Vec3<T>{t[1], t[2], T(0)};
  const T n_S = inner(n, S);
  PhotoMismatch<T> result{true, T(1) - q, -n_S / n_u};
  const Vec3<T> by_n = (S - u * (n_S / n_u)) * (-at.o / n_u);
  result.by_normal = (by_n - n * inner(n, by_n)) / length;
  return result;
}

// ---- a picture ---------------------------------------------------------------------------------

/// A photo's surface, and what it is compared with.
struct SurfacePicture {
  Camera camera;
  const SurfaceRow* sums;      // (H, W)
  const float* inverse_depth;  // (H, W)  mean_inverse_depth()
  GrayPhoto photo;
  SurfaceWeights weights = {};  // of one pixel, and of one patch
  NormalMap prior = {};
  // For weights.photo > 0.
  NeighborCamera<float> neighbor = {};
  GrayPhoto other = {};
  int phase = 0;  // of the patches of this step, below kPatchStride^2

  GS_HD std::size_t index(int x, int y) const {
    return std::size_t(y) * std::size_t(camera.width) + std::size_t(x);
  }
  /// The surface of a pixel; false where it or one of the four around it has none, where they are
  /// not those of one surface, and where the photo's mask leaves the pixel out.
  GS_HD bool find(int x, int y, PixelSurface<float>& at) const {
    if (x < 1 || y < 1 || x >= camera.width - 1 || y >= camera.height - 1) return false;
    const float* const o = inverse_depth + index(x, y);
    if (!(o[0] > 0) || photo.at(x, y) < 0) return false;
    const float around[4] = {o[-1], o[1], o[-camera.width], o[camera.width]};
    for (int k = 0; k < 4; ++k)
      if (!(around[k] >= (1 - kMostJump) * o[0] && around[k] <= (1 + kMostJump) * o[0]))
        return false;
    at = {o[0],
          {0.5f * (around[1] - around[0]), 0.5f * (around[3] - around[2])},
          sums[index(x, y)].of.normal};
    return inner(at.normal, at.normal) > kLeastNormal;
  }
  /// The share of a pixel in the losses of normals and of the prior, and its gradient.
  GS_HD float compare_normals(int x, int y, PixelSurface<float>& dL) const {
    PixelSurface<float> at;
    dL = {};
    float loss = 0;
    if (weights.normal > 0 && find(x, y, at)) {
      const Vec2f from = from_axis(camera, x, y);
      dL = normal_error_vjp(camera, from, at, weights.normal);
      loss = weights.normal * normal_error(camera, from, at);
    }
    return loss + compare_with_prior(x, y, dL.normal);
  }
  /// The share of a pixel in the loss of the prior; adds its gradient.
  GS_HD float compare_with_prior(int x, int y, Vec3f& dL_dnormal) const {
    const std::size_t i = index(x, y);
    const Vec3f& normal = sums[i].of.normal;
    if (!(weights.prior > 0) || !prior.pixels || !(inverse_depth[i] > 0) || photo.at(x, y) < 0 ||
        !(inner(normal, normal) > kLeastNormal))
      return 0;
    const NormalBytes known = prior.at(x, y);
    if (!known.is_known()) return 0;
    dL_dnormal += prior_error_vjp(normal, known.normal(), weights.prior);
    return weights.prior * prior_error(normal, known.normal());
  }
  GS_HD int patches_across() const { return (camera.width + kPatchStride - 1) / kPatchStride; }
  GS_HD int patches_down() const { return (camera.height + kPatchStride - 1) / kPatchStride; }
  /// The share of a patch in the loss of photos; adds its gradient to that of its middle pixel.
  GS_HD float compare_photos(int patch, PixelSurface<float>* dL) const {
    const int x = patch % patches_across() * kPatchStride + phase % kPatchStride;
    const int y = patch / patches_across() * kPatchStride + phase / kPatchStride;
    PixelSurface<float> at;
    if (!find(x, y, at)) return 0;
    const PhotoMismatch<float> found = photo_mismatch(camera, neighbor, x, y, at, photo, other);
    if (!found.is_known) return 0;
    PixelSurface<float>& to = dL[index(x, y)];
    to.o += weights.photo * found.by_o;
    to.normal += found.by_normal * weights.photo;
    return weights.photo * found.error;
  }
  /// dL by the sums of a pixel, from those by the surfaces of all pixels: the slope of a pixel is
  /// half of the difference of the two beside it.
  GS_HD SurfaceRow gradient(int x, int y, const PixelSurface<float>* dL) const {
    const std::size_t i = index(x, y);
    if (!(inverse_depth[i] > 0)) return {};
    float by_o = dL[i].o;
    if (x > 0) by_o += 0.5f * dL[i - 1].slope.x;
    if (x < camera.width - 1) by_o -= 0.5f * dL[i + 1].slope.x;
    if (y > 0) by_o += 0.5f * dL[i - std::size_t(camera.width)].slope.y;
    if (y < camera.height - 1) by_o -= 0.5f * dL[i + std::size_t(camera.width)].slope.y;
    return pixel_sums_vjp(sums[i], from_axis(camera, x, y), inverse_depth[i], by_o, dL[i].normal);
  }
};

/// Weights of one pixel and of one patch, so that the loss is a sum of means over the whole picture.
GS_HD SurfaceWeights weights_of_each(const SurfaceWeights& weights, const Camera& camera) {
  const float pixels = float(camera.width) * float(camera.height);
  return {weights.normal / pixels, weights.photo * float(kPatchStride * kPatchStride) / pixels,
          weights.prior / pixels};
}

}  // namespace gs
