// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/density/spacetime_density.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

TEST(FoldedTime, StaysWithinTheScene) {
  EXPECT_NEAR(folded_time(0.3f), 0.3, 1e-6);
  EXPECT_NEAR(folded_time(1.2f), 0.8, 1e-6);
  EXPECT_NEAR(folded_time(2.2f), 0.2, 1e-6);
  EXPECT_NEAR(folded_time(3.9f), 0.1, 1e-6);
  EXPECT_NEAR(folded_time(-0.25f), 0.25, 1e-6);
  EXPECT_NEAR(folded_time(-1.75f), 0.25, 1e-6);
  TestRandom random;
  for (int k = 0; k < 1000; ++k) {
    const float t = folded_time(float(random.uniform(-300, 300)));
    EXPECT_TRUE(t >= 0.0f && t <= 1.0f) << t;
  }
}

struct Parent {
  QuatPair<float> rotations;
  Vec3f log_scale;
  float log_time_scale, time_mean;
};

Parent random_parent(TestRandom& random, double least_log_time_scale) {
  return {{random.float_quaternion(), random.float_quaternion()},
          Vec3f(random.uniform3(-3, 0)),
          float(random.uniform(least_log_time_scale, 1)),
          float(random.uniform(-0.3, 1.3))};
}
Vec4f random_normal(TestRandom& random) {
  return {float(random.uniform(-2, 2)), float(random.uniform(-2, 2)), float(random.uniform(-2, 2)),
          float(random.uniform(-2, 2))};
}

// The children of a moving parent lie on its way at every moment, also those whose time was folded.
TEST(WithinTheScene, FoldsTheTimeAndKeepsThePlaceAtAMoment) {
  TestRandom random;
  int inside = 0, folded = 0;
  for (int k = 0; k < 3000; ++k) {
    const Parent p = random_parent(random, -4);
    const Vec4f move =
        split_move(p.rotations, p.log_scale, p.log_time_scale, random_normal(random));
    const Vec4f kept =
        within_the_scene(move, p.rotations, p.log_scale, p.log_time_scale, p.time_mean);
    const float time = p.time_mean + kept.w;
    EXPECT_TRUE(time >= -1e-6f && time <= 1.000001f) << time;
    if (kept == move) {
      ++inside;
      continue;
    }
    ++folded;
    const Vec4f variance(std::exp(2 * p.log_scale.x), std::exp(2 * p.log_scale.y),
                         std::exp(2 * p.log_scale.z), std::exp(2 * p.log_time_scale));
    const Vec3f v = velocity(covariance(rotation_matrix(p.rotations), variance));
    for (const float moment : {0.0f, 0.6f}) {
      const Vec3f before = Vec3f(move.x, move.y, move.z) + v * (moment - p.time_mean - move.w);
      const Vec3f after = Vec3f(kept.x, kept.y, kept.z) + v * (moment - p.time_mean - kept.w);
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(before[c], after[c], 1e-4f * std::max(1.0f, std::abs(before[c])));
    }
  }
  EXPECT_GT(inside, 500);
  EXPECT_GT(folded, 500);
}

TEST(WithinTheScene, DrawsOfALongLifeAreUniform) {
  const Parent parent{{{1, 0, 0, 0}, {1, 0, 0, 0}}, Vec3f(-3.0f), std::log(20.0f), 0.5f};
  TestRandom random;
  int of_tenth[10] = {};
  for (int k = 0; k < 10000; ++k) {
    const Vec4f move = split_move(parent.rotations, parent.log_scale, parent.log_time_scale,
                                  random_normal(random));
    const float time = parent.time_mean + within_the_scene(move, parent.rotations, parent.log_scale,
                                                           parent.log_time_scale, parent.time_mean)
                                              .w;
    ++of_tenth[std::clamp(int(time * 10), 0, 9)];
  }
  for (const int count : of_tenth) EXPECT_NEAR(count, 1000, 150);
}

}  // namespace
}  // namespace gs
