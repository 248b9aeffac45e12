// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "gs_core/types.h"

namespace gs {

/// At right angles to both, by the right-hand rule.
template <class T>
GS_HD Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

}  // namespace gs
