// SPDX-License-Identifier: Apache-2.0
// Missed updates of Adam in closed form against the loop of as many updates, in double.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "gs_core/math/lazy_adam.h"

namespace gs {
namespace {

struct Number {
  double p, m, v;
};

// Some updates by batches, with a rate that changes.
struct Updates {
  int t0;  // adam_steps before them
  int count;
  int photos = 1;
  double beta2 = kAdamBeta2;

  AdamRule rule() const { return batch_rule(photos, beta2); }
  int t(int k) const { return t0 + (k + 1) * photos; }
  float rate(int k) const { return 2.5e-3f * std::exp(-1e-3f * float(k)); }
};

// The loop, with the very factors that adam_update() takes, in double.
Number looped(Number number, const Updates& updates) {
  const AdamRule rule = updates.rule();
  for (int k = 0; k < updates.count; ++k) {
    const AdamStep step = adam_step(updates.t(k), updates.rate(k), rule.photo_beta2);
    number.m *= double(rule.beta1);
    number.v *= double(rule.beta2);
    number.p -= double(step.rate) * number.m /
                (std::sqrt(number.v) * double(step.inverse_sqrt_bias2) + double(rule.epsilon));
  }
  return number;
}

MissedUpdates missed_of(const Updates& updates) {
  MissedUpdates missed;
  const AdamRule rule = updates.rule();
  for (int k = 0; k < updates.count; ++k) {
    const AdamStep step = adam_step(updates.t(k), updates.rate(k), rule.photo_beta2);
    const AdamStep rest = adam_step(updates.t(k), 0.05f * updates.rate(k), rule.photo_beta2);
    add_update(missed, unseen_update(updates.t(k), step, rest, step, rule));
  }
  return missed;
}

// The closed form in double.
Number closed(const Number& number, const Updates& updates, LazyQuantity quantity = kLazySh0) {
  const MissedUpdates missed = missed_of(updates);
  const double epsilon = missed.epsilon_sum / missed.weight;
  return {number.p - number.m * missed.length[quantity] / (std::sqrt(number.v) + epsilon),
          number.m * missed.m_decay, number.v * missed.v_decay};
}

double relative(double actual, double expected) { return std::abs(actual / expected - 1); }

std::vector<Updates> some_updates() {
  std::vector<Updates> all;
  for (const int t0 : {1, 10, 300, 20000})
    for (const int count : {1, 2, 7, 100, kLazyWindow})
      for (const int photos : {1, 4}) {
        all.push_back({t0, count, photos});
        all.push_back({t0, count, photos, 0.99});
      }
  return all;
}

// What is left of the error comes from epsilon. Its part of the first order would vanish if the
// learning rate stayed the same; here it falls by 0.1 % in every update.
TEST(LazyAdam, IsTheLoopOfUpdatesWithoutGradients) {
  for (const Updates& updates : some_updates())
    for (const double root : {1.0, 1e-4, 1e-8, 1e-10, 1e-12}) {
      const Number number{0, 0.7 * root, root * root};
      const Number expected = looped(number, updates), actual = closed(number, updates);
      EXPECT_LT(relative(actual.p, expected.p), 1e-12 + 2e-18 / root)
          << updates.t0 << " " << updates.count << " " << root;
      EXPECT_LT(relative(actual.m, expected.m), 1e-12) << updates.t0 << " " << updates.count;
      EXPECT_LT(relative(actual.v, expected.v), 1e-12) << updates.t0 << " " << updates.count;
    }
}

// Where epsilon rules, down to v = 0, the error is the relative variance of its part over the
// updates: large in the first ones, and small once bias corrections have settled.
TEST(LazyAdam, HoldsWhereEpsilonRules) {
  for (const Updates& updates : some_updates())
    for (const double root : {1e-14, 1e-15, 1e-17, 0.0}) {
      const Number number{0, 3e-15, root * root};
      const double error = relative(closed(number, updates).p, looped(number, updates).p);
      EXPECT_LT(error, updates.t0 >= 300 ? 5e-3 : 0.2)
          << updates.t0 << " " << updates.count << " " << root;
    }
}

TEST(LazyAdam, GivesEachQuantityItsRate) {
  const Updates updates{50, 20};
  const Number number{0, 1e-3, 4e-6};
  EXPECT_LT(relative(closed(number, updates, kLazyShRest).p, 0.05 * closed(number, updates).p),
            1e-6);
}

TEST(LazyAdam, LeavesANumberThatHasMissedNothing) {
  float p = 0.3f, m = -2e-3f, v = 0;
  catch_up(p, m, v, CatchUp(), kLazySh0);
  EXPECT_EQ(p, 0.3f);
  EXPECT_EQ(m, -2e-3f);
  EXPECT_EQ(v, 0.0f);
}

TEST(LazyAdam, LeavesANumberThatNeverHadAGradient) {
  float p = 0.3f, m = 0, v = 0;
  catch_up(p, m, v, missed_of({5, 100}).catch_up, kLazySh0);
  EXPECT_EQ(p, 0.3f);
  EXPECT_EQ(m, 0.0f);
  EXPECT_EQ(v, 0.0f);
}

// In floats the closed form rounds once and the loop at every update.
TEST(LazyAdam, InFloatsIsAsGoodAsTheLoop) {
  for (const int count : {1, 5, 40, 400}) {
    const Updates updates{200, count};
    const Number start{0.25, 3e-5, 4e-10};
    const Number exact = looped(start, updates);
    float p = float(start.p), m = float(start.m), v = float(start.v);
    catch_up(p, m, v, missed_of(updates).catch_up, kLazySh0);
    EXPECT_NEAR(p, exact.p, 2e-8) << count;
    EXPECT_LT(relative(m, exact.m), 2e-7) << count;
    EXPECT_LT(relative(v, exact.v), 2e-7) << count;
  }
}

}  // namespace
}  // namespace gs
