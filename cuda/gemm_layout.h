// SPDX-License-Identifier: Apache-2.0
// Which entry of a matrix product each lane of a warp holds, as mma.cuh draws it, and in which column blend_gemm.cu puts
// which splat. Also for the CPU, where tests/stages/gemm_layout_test.cpp plays a warp.
#pragma once

#include "gs_core/types.h"

namespace gs::cuda {

inline constexpr int kBatch = 32;                // splats blended at a time
inline constexpr int kProducts = kBatch / 8;     // of their exponents, eight columns each
inline constexpr int kOwners = 4;                // lanes that share a pixel
inline constexpr int kOwned = kBatch / kOwners;  // consecutive splats that one of them has

/// The column of a batch's splat among those of all four products. A lane has columns 2 t and 2 t + 1 of each, t = lane % 4;
/// so that these are splats 8 t to 8 t + 7, column c of product j is splat (c / 2) * 8 + 2 j + c % 2.
GS_HD constexpr unsigned column_of_splat(unsigned splat) {
  const unsigned owner = splat / kOwned, own = splat % kOwned;
  return own / 2 * 8 + 2 * owner + own % 2;
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
