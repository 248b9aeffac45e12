// SPDX-License-Identifier: Apache-2.0
// The entries of a matrix product that each lane of a warp holds, as mma.cuh draws them, and the
// columns in which blend_gemm.cu puts splats. The header also compiles for the CPU:
// tests/stages/gemm_layout_test.cpp simulates a warp.
#pragma once

#include "gs_core/types.h"

namespace gs::cuda {

inline constexpr int kBatch = 32;      // splats blended at a time
inline constexpr int kHalfBatch = 16;  // for the last splats of a list, where they are no more
inline constexpr int kOwners = 4;      // lanes that share a pixel

/// Number of products for the exponents of a batch; each has eight columns.
constexpr int products_of(int batch) { return batch / 8; }
/// Number of consecutive splats that one of a pixel's lanes has.
constexpr int owned_of(int batch) { return batch / kOwners; }

/// The splat of a batch that is column c of product j. A lane has columns 2 t and 2 t + 1 of each
/// product, t = lane % 4; together they are its consecutive splats.
GS_HD constexpr unsigned splat_of_column(int batch, unsigned j, unsigned c) {
  return c / 2 * owned_of(batch) + 2 * j + c % 2;
}
/// The place of a splat's column in memory: columns lie in the order of a whole batch's products.
GS_HD constexpr unsigned place_of_splat(unsigned splat) {
  const unsigned owner = splat / owned_of(kBatch), own = splat % owned_of(kBatch);
  return own / 2 * 8 + 2 * owner + own % 2;
}
GS_HD constexpr unsigned place_of_column(int batch, unsigned j, unsigned c) {
  return batch == kBatch ? 8 * j + c : place_of_splat(splat_of_column(batch, j, c));
}

/// The place of a splat's color in a column of colors, which has those of a whole batch: first the
/// four owners' splats 0, which are b[0] of the first product, then their splats 1, and so on.
GS_HD constexpr unsigned place_of_color(unsigned splat) {
  const unsigned owner = splat / owned_of(kBatch), own = splat % owned_of(kBatch);
  return own * kOwners + owner;
}

struct Entry {
  int row, column;
};
/// d[i] of any product; its rows are pixels.
GS_HD constexpr Entry sum_entry(int lane, int i) {
  return {lane / 4 + i / 2 * 8, lane % 4 * 2 + i % 2};
}
/// Half h of a[i] and of b[i], 16 x 16 times 16 x 8.
GS_HD constexpr Entry left_entry_of_halves(int lane, int i, int h) {
  return {lane / 4 + i % 2 * 8, lane % 4 * 2 + h + i / 2 * 8};
}
GS_HD constexpr Entry right_entry_of_halves(int lane, int i, int h) {
  return {lane % 4 * 2 + h + i * 8, lane / 4};
}
/// a[i] and b[i], 16 x 8 times 8 x 8, TF32.
GS_HD constexpr Entry left_entry(int lane, int i) {
  return {lane / 4 + i % 2 * 8, lane % 4 + i / 2 * 4};
}
GS_HD constexpr Entry right_entry(int lane, int i) { return {lane % 4 + i * 4, lane / 4}; }

}  // namespace gs::cuda
