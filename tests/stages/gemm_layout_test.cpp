// SPDX-License-Identifier: Apache-2.0
// One batch of a warp of cuda/render/blend/blend_gemm.cu, emulated on the CPU in double: each lane
// gets the entries that the hardware gives it (cuda/render/blend/gemm_layout.h), composites its own
// splats, and exchanges the same values as blend_gemm.cu.
#include "cuda/render/blend/gemm_layout.h"

#include "gs_core/math/render/blend.h"
#include "tests/support/scenes.h"

namespace gs::cuda {
namespace {

constexpr int kLanes = 32, kPixels = 16;
using Matrix = std::vector<std::vector<double>>;

Matrix zeros(int rows, int columns) { return Matrix(rows, std::vector<double>(columns, 0.0)); }

Matrix product(const Matrix& a, const Matrix& b) {
  Matrix c = zeros(int(a.size()), int(b[0].size()));
  for (std::size_t i = 0; i < a.size(); ++i)
    for (std::size_t k = 0; k < b.size(); ++k)
      for (std::size_t j = 0; j < b[0].size(); ++j) c[i][j] += a[i][k] * b[k][j];
  return c;
}

TEST(GemmLayout, EveryEntryIsHeldOnce) {
  std::set<std::pair<int, int>> sums, left16, right16, left8, right8;
  const auto put = [](auto& set, Entry e) { EXPECT_TRUE(set.insert({e.row, e.column}).second); };
  for (int lane = 0; lane < kLanes; ++lane) {
    for (int i = 0; i < 4; ++i) {
      put(sums, sum_entry(lane, i));
      put(left8, left_entry(lane, i));
      for (int h = 0; h < 2; ++h) put(left16, left_entry_of_halves(lane, i, h));
    }
    for (int i = 0; i < 2; ++i) {
      put(right8, right_entry(lane, i));
      for (int h = 0; h < 2; ++h) put(right16, right_entry_of_halves(lane, i, h));
    }
  }
  EXPECT_EQ(sums.size(), 16u * 8);
  EXPECT_EQ(left16.size(), 16u * 16);
  EXPECT_EQ(right16.size(), 16u * 8);
  EXPECT_EQ(left8.size(), 16u * 8);
  EXPECT_EQ(right8.size(), 8u * 8);
}

// A splat has the same place in a whole batch and in half a batch.
TEST(GemmLayout, ALaneHasConsecutiveSplats) {
  std::array<unsigned, kBatch> splat_of_place;
  splat_of_place.fill(kBatch);
  for (unsigned splat = 0; splat < kBatch; ++splat) splat_of_place[place_of_splat(splat)] = splat;
  for (const int batch : {kBatch, kHalfBatch})
    for (int lane = 0; lane < kLanes; ++lane)
      for (int j = 0; j < products_of(batch); ++j)
        for (int i = 0; i < 4; ++i)
          EXPECT_EQ(splat_of_place[place_of_column(batch, unsigned(j),
                                                   unsigned(sum_entry(lane, i).column))],
                    unsigned(lane % kOwners * owned_of(batch) + 2 * j + i % 2));
}

// ldmatrix gives lane 4 g + t the numbers 2 t and 2 t + 1 of row g: these are the right-hand side
// whose columns are those rows.
TEST(GemmLayout, RowsOfMemoryAreColumnsOfTheProduct) {
  for (int lane = 0; lane < kLanes; ++lane)
    for (int h = 0; h < 2; ++h) {
      const Entry entry = right_entry_of_halves(lane, 0, h);
      EXPECT_EQ(entry.column, lane / 4);
      EXPECT_EQ(entry.row, 2 * (lane % 4) + h);
    }
}

// ldmatrix gives lane 4 g + t number t of row g, here of a column of colors: four places are b[i] of
// product j, splats 2 j + i of the four owners. Half a batch is read one number at a time, each at
// its distance from the lane's first.
TEST(GemmLayout, ColorsOfFourOwnersLieTogether) {
  std::set<unsigned> places;
  for (unsigned splat = 0; splat < kBatch; ++splat) places.insert(place_of_color(splat));
  EXPECT_EQ(places.size(), unsigned(kBatch));
  EXPECT_EQ(*places.rbegin(), unsigned(kBatch) - 1);
  for (int lane = 0; lane < kLanes; ++lane)
    for (int j = 0; j < products_of(kBatch); ++j)
      for (int i = 0; i < 2; ++i) {
        const Entry entry = right_entry(lane, i);
        const unsigned splat = unsigned(lane % kOwners * owned_of(kBatch) + 2 * j + i);
        EXPECT_EQ(place_of_color(splat), unsigned(8 * j + entry.row));
      }
  for (unsigned owner = 0; owner < kOwners; ++owner)
    for (unsigned i = 0; i < owned_of(kHalfBatch); ++i) {
      const unsigned first = owner * owned_of(kHalfBatch);
      EXPECT_EQ(place_of_color(first + i), place_of_color(first) + place_of_color(i));
    }
}

// The sums of the first product are, without moving them, the left-hand side of the second: entry k
// of its inner dimension is splat 2 j of the lane for k < 4, else splat 2 j + 1.
TEST(GemmLayout, WeightsLieAsALeftHandSide) {
  for (int lane = 0; lane < kLanes; ++lane) {
    const int from[4] = {0, 2, 1, 3};  // sums that become a[0], a[1], a[2], a[3]
    for (int i = 0; i < 4; ++i) {
      const Entry sum = sum_entry(lane, from[i]), a = left_entry(lane, i);
      EXPECT_EQ(sum.row, a.row);
      EXPECT_EQ(sum.column, a.column % 4 * 2 + a.column / 4);
    }
  }
}

void composite_a_batch(const int batch) {
  Draws draws(7);
  const int owned = owned_of(batch), products = products_of(batch);
  // Alphas of the splats at 16 pixels, and colors.
  Matrix alpha = zeros(kPixels, batch), colors = zeros(batch, 3);
  for (auto& row : alpha)
    for (double& a : row) a = draws.uniform(0.0f, 1.0f) < 0.4f ? 0.0 : draws.uniform(0.004f, 0.3f);
  for (auto& row : colors)
    for (double& c : row) c = draws.uniform(0.0f, 1.0f);

  // The values of the lanes after the first products.
  double own[kLanes][owned_of(kBatch)][2];
  for (int lane = 0; lane < kLanes; ++lane)
    for (int j = 0; j < products; ++j)
      for (int i = 0; i < 4; ++i) {
        const Entry entry = sum_entry(lane, i);
        own[lane][2 * j + i % 2][i / 2] =
            alpha[entry.row][splat_of_column(batch, unsigned(j), unsigned(entry.column))];
      }
  // Each lane by itself, then with the light that reaches it.
  double weights[kLanes][owned_of(kBatch)][2];
  for (int r = 0; r < 2; ++r) {
    double through[kLanes];
    for (int lane = 0; lane < kLanes; ++lane) {
      through[lane] = 1;
      for (int i = 0; i < owned; ++i) through[lane] *= 1 - own[lane][i][r];
    }
    for (int lane = 0; lane < kLanes; ++lane) {
      const double next = through[lane ^ 1];
      const double other_pair = through[lane ^ 2] * through[(lane ^ 2) ^ 1];
      double reaching = (lane & 1 ? next : 1.0) * (lane & 2 ? other_pair : 1.0);
      for (int i = 0; i < owned; ++i) {
        weights[lane][i][r] = reaching * own[lane][i][r];
        reaching -= weights[lane][i][r];
      }
    }
  }
  // The second products.
  Matrix sums = zeros(kPixels, 8);
  for (int j = 0; j < products; ++j) {
    Matrix left = zeros(kPixels, 8), right = zeros(8, 8);
    for (int lane = 0; lane < kLanes; ++lane) {
      const double a[4] = {weights[lane][2 * j][0], weights[lane][2 * j][1],
                           weights[lane][2 * j + 1][0], weights[lane][2 * j + 1][1]};
      for (int i = 0; i < 4; ++i) {
        const Entry entry = left_entry(lane, i);
        left[entry.row][entry.column] = a[i];
      }
      for (int i = 0; i < 2; ++i) {
        const Entry entry = right_entry(lane, i);
        const int splat = lane % kOwners * owned + 2 * j + i;
        right[entry.row][entry.column] = entry.column < 3 ? colors[splat][entry.column] : 0.0;
      }
    }
    const Matrix part = product(left, right);
    for (int p = 0; p < kPixels; ++p)
      for (int c = 0; c < 8; ++c) sums[p][c] += part[p][c];
  }

  for (int p = 0; p < kPixels; ++p) {
    PixelState<double> pixel;
    for (int splat = 0; splat < batch; ++splat)
      composite(pixel, Vec3<double>(colors[splat][0], colors[splat][1], colors[splat][2]),
                alpha[p][splat]);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(sums[p][c], pixel.color[c], 1e-14);
  }
}

TEST(GemmLayout, AWarpCompositesLikeOnePixelAfterTheOther) {
  composite_a_batch(kBatch);
  composite_a_batch(kHalfBatch);
}

}  // namespace
}  // namespace gs::cuda
