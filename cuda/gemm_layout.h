// SPDX-License-Identifier: Apache-2.0
// Which entry of a matrix product each lane of a warp holds, as mma.cuh draws it, and in which column blend_gemm.cu puts
// which splat. Also for the CPU, where tests/stages/gemm_layout_test.cpp plays a warp.
#pragma once

#include "gs_core/types.h"

namespace gs::cuda {

inline constexpr int kBatch = 32;      // splats blended at a time; the last of a list are half as many where that is enough
inline constexpr int kHalfBatch = 16;
inline constexpr int kOwners = 4;      // lanes that share a pixel

/// Products of a batch's exponents, eight columns each.
constexpr int products_of(int batch) { return batch / 8; }
/// Consecutive splats that one of a pixel's lanes has.
constexpr int owned_of(int batch) { return batch / kOwners; }

/// Which of a batch's splats is column c of product j. A lane has columns 2 t and 2 t + 1 of each, t = lane % 4; they are
/// its consecutive splats.
GS_HD constexpr unsigned splat_of_column(int batch, unsigned j, unsigned c) {
  return c / 2 * owned_of(batch) + 2 * j + c % 2;
}
/// Where that column lies in memory: in the order of a whole batch's products.
GS_HD constexpr unsigned place_of_splat(unsigned splat) {
  const unsigned owner = splat / owned_of(kBatch), own = splat % owned_of(kBatch);
  return own / 2 * 8 + 2 * owner + own % 2;
}
GS_HD constexpr unsigned place_of_column(int batch, unsigned j, unsigned c) {
  return batch == kBatch ? 8 * j + c : place_of_splat(splat_of_column(batch, j, c));
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
