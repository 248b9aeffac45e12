// SPDX-License-Identifier: Apache-2.0
#include "gs_core/gaussians.h"

#include <algorithm>

#include "gs_core/error.h"

namespace gs {

void copy_columns(const ConstColumns& from, const Columns& to) {
  GS_CHECK(from.size() == to.size());
  for (std::size_t k = 0; k < from.size(); ++k) to[k].rows->copy_from(*from[k].rows);
}

Gaussians rows_like(const Gaussians& like, std::size_t count, Memory& memory) {
  Gaussians rows(memory);
  rows.has_time = like.has_time;
  rows.has_filter = like.has_filter;
  rows.resize(count);
  return rows;
}

Gaussians copy_of(const Gaussians& from, Memory& memory) {
  Gaussians copy = rows_like(from, 0, memory);
  copy_columns(from.columns(), copy.columns());
  return copy;
}

Gaussians rows_of(const Gaussians& from, const std::vector<std::uint32_t>& source) {
  Gaussians rows = rows_like(from, source.size(), host_memory());
  const Columns to = rows.columns();
  const ConstColumns all = from.columns();
  for (std::size_t k = 0; k < to.size(); ++k)
    for (std::size_t i = 0; i < source.size(); ++i)
      std::copy_n(all[k].rows->row(source[i]), all[k].rows->row_bytes(), to[k].rows->row(i));
  return rows;
}

void copy_rows(const Gaussians& from, std::size_t first, std::size_t count, const Gaussians& to,
               std::size_t at) {
  const ConstColumns source = from.columns(), target = to.columns();
  GS_CHECK(source.size() == target.size());
  for (std::size_t k = 0; k < source.size(); ++k)
    std::copy_n(source[k].rows->row(first), count * source[k].rows->row_bytes(),
                target[k].rows->row(at));
}

}  // namespace gs
