// SPDX-License-Identifier: Apache-2.0
// Stage 9 for Gaussians in space and time: what density.h and mcmc.h say of space, with time.
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/math/spacetime/spacetime.h"

namespace gs {

/// False if the Gaussian has no moment at which it is visible: no right rotation, or a time that is
/// not finite.
GS_HD bool is_ever_visible(const Quatf& right_rotation, float time_mean, float log_time_scale) {
  const float time = time_mean + log_time_scale;
  return !is_degenerate(right_rotation) && time - time == 0.0f;
}

/// How one half of a split lies to its parent, in world units and units of time: a draw from the
/// parent itself, R diag(s) n.   Faster-GS, 4D
///
/// normal  four independent standard normal numbers
GS_HD Vec4f split_move(const QuatPair<float>& rotations, const Vec3f& log_scale,
                       float log_time_scale, const Vec4f& normal) {
  using std::exp;
  const Vec4f local{exp(log_scale.x) * normal.x, exp(log_scale.y) * normal.y,
                    exp(log_scale.z) * normal.z, exp(log_time_scale) * normal.w};
  const Mat4<float> R = rotation_matrix(rotations);
  return {inner(R.row[0], local), inner(R.row[1], local), inner(R.row[2], local),
          inner(R.row[3], local)};
}

/// A time folded into the scene's, [0, 1], at both of its ends: 1.2 becomes 0.8, and 2.2 0.2.
GS_HD float folded_time(float time) {
  using std::floor;
  const float t = time - 2.0f * floor(0.5f * time);
  return t > 1.0f ? 2.0f - t : t;
}
/// A move of split_move(), changed so that the half lies within the scene's time. A Gaussian that
/// lives longer than the scene has most draws outside, where they are of no use: within the scene
/// such a half is fainter than its parent. The half goes along its parent's velocity to the folded
/// time. This leaves its place at any one moment as it was drawn.   ours
///
/// time_mean  of the parent
GS_HD Vec4f within_the_scene(const Vec4f& move, const QuatPair<float>& rotations,
                             const Vec3f& log_scale, float log_time_scale, float time_mean) {
  using std::exp;
  const float time = time_mean + move.w;
  if (time >= 0.0f && time <= 1.0f) return move;
  const float shift = folded_time(time) - time;
  const Vec3f v = velocity(covariance(rotation_matrix(rotations),
                                      Vec4f(exp(2.0f * log_scale.x), exp(2.0f * log_scale.y),
                                            exp(2.0f * log_scale.z), exp(2.0f * log_time_scale))));
  return {move.x + shift * v.x, move.y + shift * v.y, move.z + shift * v.z, move.w + shift};
}
/// Log scale in time of both halves.
GS_HD float split_log_time_scale(float log_time_scale) {
  using std::log;
  return log_time_scale - log(kSplitScaleDivisor);
}

}  // namespace gs
