// SPDX-License-Identifier: Apache-2.0
// The learned quantities: one array per quantity, one row per Gaussian. Parameters and gradients are
// both of this one type; moment_arrays.h has Adam's moments of them.
#pragma once

#include "gs_core/buffer.h"

namespace gs {

inline constexpr int kMaxShDegree = 3;
inline constexpr int kShRestCount = 15;  // coefficients per channel beyond degree 0, at degree 3

/// Coefficients of one SH degree and all below it, without degree 0.
constexpr int sh_rest_count(int degree) { return (degree + 1) * (degree + 1) - 1; }

/// The SH coefficients of one Gaussian from degree 1 on, in the order of math/sh.h.
struct ShRest {
  Vec3f coefficient[kShRestCount];
};

template <template <class> class Array>
struct GaussianArrays {
  Array<Vec3f> mean;           // (N, 3)      world units
  Array<Vec3f> log_scale;      // (N, 3)      log of world units
  Array<Quatf> rotation;       // (N, 4)      w x y z, any length > 0
  Array<float> logit_opacity;  // (N)
  Array<Vec3f> sh0;            // (N, 3)      color = 0.5 + C0 * sh0 + ...
  Array<ShRest> sh_rest;       // (N, 15, 3)  zero beyond the degree in use
  // Gaussians in space and time (math/spacetime.h) have three arrays more; of others they are empty.
  bool has_time = false;
  Array<Quatf> right_rotation{};  // (N, 4)   w x y z, any length > 0; `rotation` is the left one
  Array<float> time_mean{};       // (N)      in units of the scene's time (PinholeCamera::time)
  Array<float> log_time_scale{};  // (N)      log of such units
  // With the 3D filter (math/filter_3d.h) each Gaussian has one number that is not learned.
  bool has_filter = false;
  Array<float> filter_scale{};  // (N)        standard deviation of its filter, world units
};

/// Calls f(name, a.array, b.array, ...) for each learned quantity that `first` has, in a fixed
/// order. Gradients, moments and learning rates have these arrays; Adam is one such loop.
template <class F, class First, class... Rest>
void for_each_array(F&& f, First&& first, Rest&&... rest) {
  f("mean", first.mean, rest.mean...);
  f("log_scale", first.log_scale, rest.log_scale...);
  f("rotation", first.rotation, rest.rotation...);
  f("logit_opacity", first.logit_opacity, rest.logit_opacity...);
  f("sh0", first.sh0, rest.sh0...);
  f("sh_rest", first.sh_rest, rest.sh_rest...);
  if (!first.has_time) return;
  f("right_rotation", first.right_rotation, rest.right_rotation...);
  f("time_mean", first.time_mean, rest.time_mean...);
  f("log_time_scale", first.log_time_scale, rest.log_time_scale...);
}

/// The same for every array that `first` has, learned or not. Gather, prune, files and checkpoints
/// are one such loop each, so that a new quantity is a few lines in this file.
template <class F, class First, class... Rest>
void for_each_stored_array(F&& f, First&& first, Rest&&... rest) {
  for_each_array(f, first, rest...);
  if (first.has_filter) f("filter_scale", first.filter_scale, rest.filter_scale...);
}

/// Says that `to` has the learned quantities of `like`. Call it before rows are added.
template <class To, class Like>
void take_learned_arrays(To& to, const Like& like) {
  to.has_time = like.has_time;
}

using GaussiansSpan = GaussianArrays<Span>;

/// Arrays without rows that own what they hold, in this memory.
template <template <class> class Array>
GaussianArrays<Array> arrays_in(Memory& memory) {
  return {.mean = Array<Vec3f>(memory),
          .log_scale = Array<Vec3f>(memory),
          .rotation = Array<Quatf>(memory),
          .logit_opacity = Array<float>(memory),
          .sh0 = Array<Vec3f>(memory),
          .sh_rest = Array<ShRest>(memory),
          .right_rotation = Array<Quatf>(memory),
          .time_mean = Array<float>(memory),
          .log_time_scale = Array<float>(memory),
          .filter_scale = Array<float>(memory)};
}

/// Owns the arrays of N Gaussians. It can be moved; copy_of() makes a copy.
struct Gaussians : GaussianArrays<Buffer> {
  explicit Gaussians(Memory& memory = host_memory())
      : GaussianArrays<Buffer>(arrays_in<Buffer>(memory)) {}
  Gaussians(std::size_t count, Memory& memory, bool with_time = false) : Gaussians(memory) {
    has_time = with_time;
    resize(count);
  }

  std::size_t count() const { return mean.size(); }
  Memory& memory() const { return mean.memory(); }
  void resize(std::size_t count) {
    for_each_stored_array([&](const char*, auto& array) { array.resize(count); }, *this);
  }
  void fill_zero() {
    for_each_stored_array([](const char*, auto& array) { array.fill_zero(); }, *this);
  }
  GaussiansSpan span() const {
    GaussiansSpan result;
    take_learned_arrays(result, *this);
    result.has_filter = has_filter;
    for_each_stored_array([](const char*, auto& to, const auto& from) { to = from.span(); }, result,
                          *this);
    return result;
  }
};

/// Rows with the same arrays as those of `like`; their contents are undefined.
inline Gaussians rows_like(const Gaussians& like, std::size_t count, Memory& memory) {
  Gaussians rows(memory);
  take_learned_arrays(rows, like);
  rows.has_filter = like.has_filter;
  rows.resize(count);
  return rows;
}

/// A second set of Gaussians with the same contents, in the same memory.
inline Gaussians copy_of(const Gaussians& from) {
  Gaussians copy = rows_like(from, from.count(), from.memory());
  for_each_stored_array(
      [](const char*, auto& to, const auto& array) {
        if (array.size())
          array.memory().copy(to.data(), array.data(), array.size() * sizeof(*array.data()));
      },
      copy, from);
  return copy;
}

/// Host memory only: rows source[0], source[1], ... of `from`.
inline Gaussians rows_of(const Gaussians& from, const std::vector<std::uint32_t>& source) {
  Gaussians rows = rows_like(from, source.size(), host_memory());
  for_each_stored_array(
      [&](const char*, auto& to, const auto& array) {
        for (std::size_t i = 0; i < source.size(); ++i) to[i] = array[source[i]];
      },
      rows, from);
  return rows;
}

/// Trained Gaussians as files hold them: in host memory, with the SH degree that they use.
struct GaussianModel {
  Gaussians gaussians;
  int sh_degree = kMaxShDegree;       // 0..3; coefficients beyond it are zero
  bool is_ours = true;                // false: read from a file that another trainer wrote
  bool antialiased = false;           // trained with the antialiased projection (math/projection.h)
  Vec3d world_offset{0.0, 0.0, 0.0};  // as in Scene; add it to have the photos' coordinates
};

/// Downloads Gaussians from the memory in which they lie.
inline GaussianModel host_copy(const Gaussians& from, int sh_degree, bool antialiased) {
  GaussianModel model{rows_like(from, from.count(), host_memory()), sh_degree, true, antialiased};
  for_each_stored_array(
      [](const char*, auto& to, const auto& array) {
        if (array.size())
          array.memory().download(to.data(), array.data(), array.size() * sizeof(*array.data()));
      },
      model.gaussians, from);
  return model;
}

/// Uploads the Gaussians of a file to a backend's memory, ready to render.
inline Gaussians copy_to(Memory& memory, const GaussianModel& from) {
  Gaussians copy = rows_like(from.gaussians, from.gaussians.count(), memory);
  for_each_stored_array(
      [&](const char*, auto& to, const auto& array) {
        if (array.size())
          memory.upload(to.data(), array.data(), array.size() * sizeof(*array.data()));
      },
      copy, from.gaussians);
  return copy;
}

}  // namespace gs
