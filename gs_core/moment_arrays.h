// SPDX-License-Identifier: Apache-2.0
// Adam's moments of N Gaussians: for each learned quantity one array, whose rows have a pair of
// moments for each number.
#pragma once

#include <variant>

#include "gs_core/gaussians.h"
#include "gs_core/math/update/adam_moments.h"
#include "gs_core/math/update/moment_storage.h"

namespace gs {

/// The moments of a row of T. Stored is FloatMoments or HalfMoments.
template <class Stored, class T>
struct MomentRow {
  Stored number[kNumbersOf<T>];
};

/// The moments one after another, whatever the rows are.
template <class Stored, class T>
Span<Stored> moments_in(const Buffer<MomentRow<Stored, T>>& rows) {
  return {reinterpret_cast<Stored*>(rows.data()), rows.size() * kNumbersOf<T>};
}

template <class Stored>
struct MomentRows {
  template <class T>
  using Of = Buffer<MomentRow<Stored, T>>;
};

/// Owns the moments of N Gaussians.
template <class Stored>
struct AdamMoments : GaussianArrays<MomentRows<Stored>::template Of> {
  explicit AdamMoments(Memory& memory = host_memory()) { lie_in(memory, *this); }
};

/// One of these, in the order of MomentStorage.
using StoredMoments = std::variant<AdamMoments<FloatMoments>, AdamMoments<HalfMoments>>;

}  // namespace gs
