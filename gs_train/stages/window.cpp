// SPDX-License-Identifier: Apache-2.0
#include "gs_train/stages/window.h"

#include "gs_core/error.h"
#include "gs_core/math/loss/ssim.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

// One row of `out` from one row of `in`: a horizontal pass over 11 columns.
void mean_along_row(const float* in, float* out, int width) {
  const auto at = [&](int x) { return x >= 0 && x < width ? in[x] : 0.0f; };
  const auto border = [&](int x) {
    float sum = kSsimWindow[0] * in[x];
    for (int d = 1; d <= kSsimRadius; ++d) sum += kSsimWindow[d] * (at(x - d) + at(x + d));
    out[x] = sum;
  };
  const int inner_end = std::max(width - kSsimRadius, 0);
  for (int x = 0; x < std::min(kSsimRadius, width); ++x) border(x);
  for (int x = kSsimRadius; x < inner_end; ++x) {
    float sum = kSsimWindow[0] * in[x];
    for (int d = 1; d <= kSsimRadius; ++d) sum += kSsimWindow[d] * (in[x - d] + in[x + d]);
    out[x] = sum;
  }
  for (int x = std::max(inner_end, kSsimRadius); x < width; ++x) border(x);
}

// Row y of `out` from the 11 rows of the plane `in` around it: the vertical pass.
void mean_of_rows(const float* in, float* out, int y, int width, int height) {
  const float* row = in + std::size_t(y) * width;
  for (int x = 0; x < width; ++x) out[x] = kSsimWindow[0] * row[x];
  for (int d = 1; d <= kSsimRadius; ++d)
    for (const int other : {y - d, y + d}) {
      if (other < 0 || other >= height) continue;
      const float* from = in + std::size_t(other) * width;
      for (int x = 0; x < width; ++x) out[x] += kSsimWindow[d] * from[x];
    }
}

}  // namespace

void window_means(Span<float> stack, int planes, int width, int height, Buffer<float>& scratch) {
  const std::size_t rows = std::size_t(planes) * height;
  GS_CHECK(stack.size == rows * width);
  scratch.resize_discard(stack.size);
  parallel_for(rows, 16, [&](std::size_t row) {
    mean_along_row(stack.data + row * width, scratch.data() + row * width, width);
  });
  parallel_for(rows, 16, [&](std::size_t row) {
    const std::size_t plane = row / height;
    mean_of_rows(scratch.data() + plane * height * width, stack.data + row * width,
                 int(row % height), width, height);
  });
}

}  // namespace gs
