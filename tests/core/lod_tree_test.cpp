// SPDX-License-Identifier: Apache-2.0
// Levels of detail: leaves are boxes of about the same size, levels hold what was merged into them,
// and nothing depends on threads.
#include "gs_model/lod/lod_tree.h"

#include "gs_model/edit/merge_gaussians.h"
#include "gs_model/lod/splat_tree.h"
#include "tests/support/random_model.h"
#include "tests/support/same_bits.h"
#include "tests/support/test.h"

namespace gs {
namespace {

constexpr std::size_t kCount = 3000;

Gaussians cloud(std::size_t count = kCount) {
  GaussianModel model = random_model(count, 3);
  for (Vec3f& s : model.gaussians.log_scale) s = 0.3f * s - Vec3f(3);
  for (float& o : model.gaussians.logit_opacity) o -= 6;  // no merged opacity has to stop at 1
  return std::move(model.gaussians);
}

LodOptions small() {
  LodOptions options;
  options.leaf_rows = 400;
  options.coarsest_rows = 40;
  return options;
}

std::size_t num_leaves(const LodTree& tree) { return tree.levels.front().leaf_begin.size() - 1; }

double mass_of(const Gaussians& g) {
  double sum = 0;
  for (std::size_t i = 0; i < g.count(); ++i) sum += merge_shape_of(g, i).mass();
  return sum;
}

TEST(LodTree, EveryGaussianLiesInOneLeafOfTheFinestLevel) {
  const Gaussians g = cloud();
  const LodTree tree = build_lod_tree(copy_of(g), small());
  std::vector<float> before, after;
  for (std::size_t i = 0; i < kCount; ++i) before.push_back(g.mean[i].x);
  for (const Vec3f& mean : tree.levels[0].gaussians.mean) after.push_back(mean.x);
  std::sort(before.begin(), before.end());
  std::sort(after.begin(), after.end());
  EXPECT_EQ(before, after);
  for (std::size_t leaf = 0; leaf < num_leaves(tree); ++leaf) {
    EXPECT_LE(tree.levels[0].count(leaf), 400u);
    EXPECT_GE(tree.levels[0].count(leaf), 187u);  // 3000 halved four times
  }
}

TEST(LodTree, APlaneStandsBetweenAnyTwoLeaves) {
  const LodTree tree = build_lod_tree(cloud(), small());
  const LodLevel& finest = tree.levels[0];
  const auto range = [&](std::size_t leaf, int axis) {
    std::vector<float> values;
    for (std::size_t i = finest.leaf_begin[leaf]; i < finest.leaf_begin[leaf + 1]; ++i)
      values.push_back(finest.gaussians.mean[i][axis]);
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    return std::pair(*low, *high);
  };
  ASSERT_GT(num_leaves(tree), 4u);
  for (std::size_t a = 0; a < num_leaves(tree); ++a)
    for (std::size_t b = a + 1; b < num_leaves(tree); ++b) {
      bool is_between = false;
      for (int axis = 0; axis < 3; ++axis)
        is_between = is_between || range(a, axis).second <= range(b, axis).first ||
                     range(b, axis).second <= range(a, axis).first;
      EXPECT_TRUE(is_between) << a << " " << b;
    }
}

TEST(LodTree, ALevelHoldsAQuarterAndTheMassOfTheOneBeforeIt) {
  const LodTree tree = build_lod_tree(cloud(), small());
  ASSERT_EQ(tree.levels.size(), 4u);  // 3000, 750, 188, 47 or some more by rounding up
  for (std::size_t k = 0; k + 1 < tree.levels.size(); ++k) {
    const LodLevel &finer = tree.levels[k], &coarser = tree.levels[k + 1];
    for (std::size_t leaf = 0; leaf < num_leaves(tree); ++leaf)
      EXPECT_EQ(coarser.count(leaf), (finer.count(leaf) + 3) / 4);
    // Roundings of floats.
    EXPECT_NEAR(mass_of(coarser.gaussians) / mass_of(finer.gaussians), 1, 1e-4);
  }
}

TEST(LodTree, AParentLiesInTheLeafOfItsRowsAndHoldsTheirMean) {
  const LodTree tree = build_lod_tree(cloud(), small());
  const LodLevel &finer = tree.levels[0], &coarser = tree.levels[1];
  ASSERT_EQ(finer.parent.size(), kCount);
  ASSERT_TRUE(tree.levels.back().parent.empty());
  std::vector<Vec3d> sum(coarser.gaussians.count(), Vec3d(0.0));
  std::vector<double> mass(sum.size());
  for (std::size_t leaf = 0; leaf < num_leaves(tree); ++leaf)
    for (std::size_t i = finer.leaf_begin[leaf]; i < finer.leaf_begin[leaf + 1]; ++i) {
      const std::uint32_t p = finer.parent[i];
      ASSERT_GE(p, coarser.leaf_begin[leaf]);
      ASSERT_LT(p, coarser.leaf_begin[leaf + 1]);
      const double m = merge_shape_of(finer.gaussians, i).mass();
      sum[p] += m * Vec3d(finer.gaussians.mean[i]);
      mass[p] += m;
    }
  for (std::size_t p = 0; p < sum.size(); ++p) {
    const Vec3d off = sum[p] / mass[p] - Vec3d(coarser.gaussians.mean[p]);
    EXPECT_LT(inner(off, off), 1e-8);
  }
}

TEST(LodTree, IsTheSameWithAnyNumberOfThreadsAndForEqualMeans) {
  Gaussians g = cloud(1500);
  for (std::size_t i = 0; i < 900; ++i) g.mean[i] = Vec3f(0.5f, 0, 0);  // more than a leaf holds
  set_thread_count(1);
  const LodTree one = build_lod_tree(copy_of(g), small());
  set_thread_count(3);
  const LodTree three = build_lod_tree(copy_of(g), small());
  set_thread_count(0);
  ASSERT_EQ(one.levels.size(), three.levels.size());
  for (std::size_t k = 0; k < one.levels.size(); ++k) {
    EXPECT_TRUE(same_bits(one.levels[k].gaussians, three.levels[k].gaussians)) << k;
    EXPECT_EQ(one.levels[k].parent, three.levels[k].parent) << k;
  }
}

TEST(LodTree, RowsThatAreNeverRenderedAreDropped) {
  Gaussians g = cloud(100);
  g.mean[7].y = NAN;
  g.rotation[8] = {0, 0, 0, 0};
  const LodTree tree = build_lod_tree(std::move(g), small());
  EXPECT_EQ(tree.levels[0].gaussians.count(), 98u);
  EXPECT_EQ(tree.levels.size(), 1u);
  EXPECT_EQ(num_leaves(tree), 1u);
}

TEST(LodTree, EndsAtOneGaussianInEachLeaf) {
  LodOptions options;
  options.leaf_rows = 10;
  options.coarsest_rows = 1;
  const LodTree tree = build_lod_tree(cloud(10), options);
  EXPECT_EQ(tree.levels.size(), 3u);  // 10, 3, 1
  EXPECT_EQ(tree.levels.back().gaussians.count(), 1u);
}

TEST(LodTree, RefusesModelsWithoutGaussiansAndThoseWithTime) {
  EXPECT_THROW(build_lod_tree(Gaussians()), UsageError);
  EXPECT_THROW(build_lod_tree(random_moving_model(10, 0).gaussians), UsageError);
}

TEST(SplatTree, TheGaussiansWithoutChildrenAreTheModel) {
  const LodTree lod = build_lod_tree(cloud(), small());
  const SplatTree tree = splat_tree_of(lod);
  std::vector<float> leaves, model;
  for (std::size_t i = 0; i < tree.child_count.size(); ++i)
    if (tree.child_count[i] == 0) leaves.push_back(tree.gaussians.sh0[i].y);
  for (const Vec3f& sh0 : lod.levels[0].gaussians.sh0) model.push_back(sh0.y);
  std::sort(leaves.begin(), leaves.end());
  std::sort(model.begin(), model.end());
  EXPECT_EQ(leaves, model);
}

TEST(SplatTree, EveryGaussianButTheRootHasOneParentBeforeIt) {
  const SplatTree tree = splat_tree_of(build_lod_tree(cloud(), small()));
  std::vector<int> parents(tree.gaussians.count());
  for (std::uint32_t i = 0; i < parents.size(); ++i) {
    if (tree.child_count[i] == 0) {
      EXPECT_EQ(tree.child_start[i], 0u);
      continue;
    }
    EXPECT_GE(tree.child_count[i], 2u);
    EXPECT_GT(tree.child_start[i], i);
    for (std::uint32_t c = 0; c < tree.child_count[i]; ++c) ++parents.at(tree.child_start[i] + c);
  }
  EXPECT_EQ(parents[0], 0);
  EXPECT_EQ(std::count(parents.begin() + 1, parents.end(), 1), std::ptrdiff_t(parents.size()) - 1);
}

TEST(SplatTree, OneGaussianIsItsOwnRoot) {
  const SplatTree tree = splat_tree_of(build_lod_tree(cloud(1)));
  EXPECT_EQ(tree.gaussians.count(), 1u);
  EXPECT_EQ(tree.child_count[0], 0u);
}

}  // namespace
}  // namespace gs
