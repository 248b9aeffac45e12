// SPDX-License-Identifier: Apache-2.0
// Stage 10: the order along the Morton curve, and the gather that puts rows into an order.
#include "gs_core/math/density/morton.h"

#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"

namespace gs {
namespace {

/// A model whose every array tells the number of its row: 1000 a + row in array a, and row + 1 in moments.
TrainingModel numbered_model(std::size_t count) {
  TrainingModel model = model_of(Gaussians(count, host_memory()));
  float first = 0;
  const auto number = [&](const char*, const auto& array) { number_rows(array, first += 1000); };
  for_each_array(number, model.gaussians);
  number_moments(model, 1);
  number("", model.statistics.visits);
  number("", model.statistics.gradient_norm);
  return model;
}

/// Expects row i of every array to equal row source[i] of numbered_model().
void expect_rows(const TrainingModel& model, const std::vector<std::uint32_t>& source) {
  float first = 0;
  const auto expect = [&](const char* name, const auto& array) {
    first += 1000;
    ASSERT_EQ(array.size(), source.size());
    for (std::size_t i = 0; i < source.size(); ++i)
      EXPECT_TRUE(row_is(array, i, first + float(source[i]))) << name << " " << i;
  };
  for_each_array(expect, model.gaussians);
  for (std::size_t i = 0; i < source.size(); ++i)
    EXPECT_TRUE(moments_are(model, i, source[i] + 1)) << i;
  expect("visits", model.statistics.visits);
  expect("gradient_norm", model.statistics.gradient_norm);
}

TEST(GatherRows, KeepsRowsWholeAlsoWhereSomeAreTakenTwiceOrLeftOut) {
  for (const std::vector<std::uint32_t>& order :
       {random_permutation(100, 1), std::vector<std::uint32_t>{9, 9, 0, 3, 3, 3}}) {
    TrainingModel model = numbered_model(100);
    gather_rows(model.columns(), {order.data(), order.size()});
    expect_rows(model, order);
  }
}

TEST(MortonOrder, RunsAlongTheCurveAndEqualCodesByRow) {
  Draws draws(2);
  Buffer<Vec3f> means(5000, host_memory());
  for (Vec3f& mean : means) mean = draws.uniform3(-3, 5);
  for (std::size_t i = 0; i < 1000; ++i) means[4000 + i] = means[i];  // equal codes
  Vec3f low(1e30f), high(-1e30f);
  for (const Vec3f& mean : means)
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], mean[axis]);
      high[axis] = std::max(high[axis], mean[axis]);
    }
  const float size = std::max({high.x - low.x, high.y - low.y, high.z - low.z});
  std::vector<std::uint32_t> expected(means.size());
  std::iota(expected.begin(), expected.end(), 0u);
  std::stable_sort(expected.begin(), expected.end(), [&](auto a, auto b) {
    return morton_code(means[a], low, size) < morton_code(means[b], low, size);
  });
  EXPECT_EQ(morton_order(means.span(), {}).download(), expected);
}

TEST(MortonOrder, BringsNeighborsTogether) {
  Draws draws(3);
  Buffer<Vec3f> means(20'000, host_memory());
  for (Vec3f& mean : means) mean = draws.uniform3(0, 1);
  const Buffer<std::uint32_t> order = morton_order(means.span(), {});
  double step = 0;
  for (std::size_t k = 1; k < means.size(); ++k) {
    const Vec3f offset = means[order[k]] - means[order[k - 1]];
    step += std::sqrt(inner(offset, offset)) / double(means.size());
  }
  // 0.66 between random points; 0.037 between grid neighbors at this density
  EXPECT_LT(step, 0.06);
}

TEST(MortonOrder, TakesDegenerateSetsOfPoints) {
  Buffer<Vec3f> means(4, host_memory());
  EXPECT_EQ(morton_order({means.data(), 0}, {}).size(), 0u);
  EXPECT_EQ(morton_order({means.data(), 1}, {}).download(), (std::vector<std::uint32_t>{0}));
  std::fill(means.begin(), means.end(), Vec3f(2.5f));
  EXPECT_EQ(morton_order(means.span(), {}).download(), (std::vector<std::uint32_t>{0, 1, 2, 3}));
}

TEST(MortonOrder, IsNotBlindedByValuesThatAreNotFinite) {
  Buffer<Vec3f> means(5, host_memory());
  means[0] = Vec3f(3.0f);
  means[1] = Vec3f(std::numeric_limits<float>::infinity());
  means[2] = Vec3f(1.0f);
  means[3] = Vec3f(std::numeric_limits<float>::quiet_NaN());
  means[4] = Vec3f(2.0f);
  std::vector<std::uint32_t> finite;
  for (const std::uint32_t i : morton_order(means.span(), {}))
    if (i % 2 == 0) finite.push_back(i);
  EXPECT_EQ(finite, (std::vector<std::uint32_t>{2, 4, 0}));
}

TEST(SortByMorton, MovesRowsWholeToTheirPlaceOnTheCurve) {
  TrainingModel model = numbered_model(50);
  Draws draws(4);
  std::vector<Vec3f> means(50);
  for (Vec3f& mean : means) mean = draws.uniform3(-1, 1);
  model.gaussians.mean.upload(means);
  const std::vector<std::uint32_t> order = morton_order(model.gaussians.mean.span(), {}).download();
  make_scalar_row_ops()->sort_by_morton(model);
  for (std::size_t i = 0; i < 50; ++i) {
    EXPECT_EQ(model.gaussians.mean[i], means[order[i]]);
    model.gaussians.mean[i] = Vec3f(1000.0f + float(order[i]));
  }
  expect_rows(model, order);
}

}  // namespace
}  // namespace gs
