// SPDX-License-Identifier: Apache-2.0
// What the values of a depth map mean.
#pragma once

namespace gs {

/// Depth is the distance along the viewing axis, not along the ray.
enum class DepthKind {
  automatic,  // as the sparse points tell (data_loaders/scene/depth/depth_kind_of.h)
  metric,     // depth in world units
  scaled,     // depth times a factor of each photo: metric maps of a model in other units
  relative,   // scale * value + shift is the depth, with numbers of each photo
  inverse,    // scale * value + shift is the inverse depth, with numbers of each photo
};

}  // namespace gs
