// SPDX-License-Identifier: Apache-2.0
// The learned quantities: one array per quantity, one row per Gaussian. Parameters and gradients are
// both of this one type; moment_arrays.h has Adam's moments of them. Columns are these arrays as
// bytes.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "gs_core/buffer.h"

namespace gs {

inline constexpr int kMaxShDegree = 3;
inline constexpr int kShRestCount = 15;  // coefficients per channel beyond degree 0, at degree 3

/// Coefficients of one SH degree and all below it, without degree 0.
constexpr int sh_rest_count(int degree) { return (degree + 1) * (degree + 1) - 1; }
/// The degree with so many, as sh_rest_count() says; nothing where no degree up to kMaxShDegree has.
constexpr std::optional<int> sh_degree_with(std::int64_t rest_count) {
  for (int degree = 0; degree <= kMaxShDegree; ++degree)
    if (sh_rest_count(degree) == rest_count) return degree;
  return std::nullopt;
}

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

/// What a column holds. It decides what the row of a new Gaussian starts with.
enum class RowRole {
  parameter,  // a new Gaussian has those of the Gaussian that it is made from
  moment,     // of Adam; a new Gaussian starts with zeros
  statistic,  // of density control; every Gaussian starts with zeros after a refinement
};

/// One array with a row per Gaussian, for example {moment, "moments", "mean"}. Copies, row
/// operations, checkpoints and forecasts are loops over columns, which need no type of a row.
template <class Rows>
struct ColumnOf {
  RowRole role;
  const char* group;
  const char* name;
  Rows* rows;

  /// "moments.mean": checkpoint files name their sections like this.
  std::string key() const { return std::string(group) + "." + name; }
};
using Column = ColumnOf<ByteBuffer>;
using ConstColumn = ColumnOf<const ByteBuffer>;
using Columns = std::vector<Column>;
using ConstColumns = std::vector<ConstColumn>;
/// The columns of an owner of arrays, which may be const.
template <class Owner>
using ColumnsIn = std::conditional_t<std::is_const_v<Owner>, ConstColumns, Columns>;

/// The columns of parameters, gradients or moments, in a fixed order: what is learned, then what is
/// not.
template <class Arrays>
ColumnsIn<Arrays> columns_in(Arrays& arrays, RowRole role, const char* group) {
  ColumnsIn<Arrays> columns;
  const auto add = [&](const char* name, auto& rows) {
    columns.push_back({role, group, name, &rows});
  };
  for_each_array(add, arrays);
  if (arrays.has_filter) add("filter_scale", arrays.filter_scale);
  return columns;
}

using GaussiansSpan = GaussianArrays<Span>;

/// Arrays without rows that lie in this memory, also those that they lack so far.
template <class Arrays>
void lie_in(Memory& memory, Arrays& arrays) {
  arrays.has_time = arrays.has_filter = true;
  for (const Column& column : columns_in(arrays, RowRole::parameter, "")) column.rows->use(memory);
  arrays.has_time = arrays.has_filter = false;
}

/// Owns the arrays of N Gaussians. It can be moved; copy_of() makes a copy.
struct Gaussians : GaussianArrays<Buffer> {
  explicit Gaussians(Memory& memory = host_memory()) { lie_in(memory, *this); }
  Gaussians(std::size_t count, Memory& memory, bool with_time = false) : Gaussians(memory) {
    has_time = with_time;
    resize(count);
  }

  std::size_t count() const { return mean.size(); }
  Memory& memory() const { return mean.memory(); }
  Columns columns() { return columns_in(*this, RowRole::parameter, "gaussians"); }
  ConstColumns columns() const { return columns_in(*this, RowRole::parameter, "gaussians"); }
  void resize(std::size_t count) {
    for (const Column& column : columns()) column.rows->resize(count);
  }
  void fill_zero() {
    for (const Column& column : columns()) column.rows->fill_zero();
  }
  GaussiansSpan span() const {
    GaussiansSpan result;
    result.has_time = has_time;
    result.has_filter = has_filter;
    for_each_array([](const char*, auto& to, const auto& from) { to = from.span(); }, result,
                   *this);
    if (has_filter) result.filter_scale = filter_scale.span();
    return result;
  }
};

/// Columns become copies of the same columns, which may lie in another memory.
void copy_columns(const ConstColumns& from, const Columns& to);

/// Rows with the same arrays as those of `like`; their contents are undefined.
Gaussians rows_like(const Gaussians& like, std::size_t count, Memory& memory);

/// Gaussians with the same contents in a memory.
Gaussians copy_of(const Gaussians& from, Memory& memory);
inline Gaussians copy_of(const Gaussians& from) { return copy_of(from, from.memory()); }

/// Host memory only: rows source[0], source[1], ... of `from`.
Gaussians rows_of(const Gaussians& from, const std::vector<std::uint32_t>& source);

/// Host memory only: `count` rows of `from`, from row `first` on, become the rows of `to` from row
/// `at` on. Both have the same arrays.
void copy_rows(const Gaussians& from, std::size_t first, std::size_t count, const Gaussians& to,
               std::size_t at);

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
  return {copy_of(from, host_memory()), sh_degree, true, antialiased};
}

/// Uploads the Gaussians of a file to a backend's memory, ready to render.
inline Gaussians copy_to(Memory& memory, const GaussianModel& from) {
  return copy_of(from.gaussians, memory);
}

}  // namespace gs
