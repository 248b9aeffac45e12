// SPDX-License-Identifier: Apache-2.0
// What watching costs a run, by clocks of the test's own; and where a look around begins.
#include "gs_app/view/live_view.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "data_loaders/formats/formats.h"
#include "gs_core/error.h"
#include "tests/support/small_scene.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using Json = nlohmann::json;

/// A clock that stands still until it is told otherwise.
struct Hands {
  double now = 1000;
  LookBudget::Clock clock() {
    return [this] { return now; };
  }
};

TEST(LookBudget, NobodyWatchesUntilSomebodyAsks) {
  Hands hands;
  LookBudget budget(hands.clock());
  EXPECT_FALSE(budget.may_look());
  budget.watch();
  EXPECT_TRUE(budget.may_look());
  hands.now += LookBudget::kWatchSeconds + 0.01;
  EXPECT_FALSE(budget.may_look()) << "the watcher has gone";
  budget.watch();
  EXPECT_TRUE(budget.may_look());
}

TEST(LookBudget, ALookBarsTheNextForAHundredTimesItsCost) {
  Hands hands;
  LookBudget budget(hands.clock());
  budget.look([&] { hands.now += 0.2; });
  hands.now += 19.9;
  budget.watch();
  EXPECT_FALSE(budget.may_look());
  hands.now += 0.2;
  EXPECT_TRUE(budget.may_look());
}

TEST(LookBudget, LooksTakeNoMoreThanAHundredthOfTheTimeWhateverTheyCost) {
  Hands hands;
  LookBudget budget(hands.clock());
  const double begin = hands.now;
  Draws draws(1);
  double spent = 0, last = 0;
  for (int step = 0; step < 200'000; ++step) {
    hands.now += 0.01;
    budget.watch();
    if (!budget.may_look()) continue;
    last = draws.log_uniform(0.001f, 2.0f);
    budget.look([&] { hands.now += last; });
    spent += last;
  }
  EXPECT_GT(spent, 0);
  EXPECT_LE(spent - last, (hands.now - begin) / 100);  // the pause after the last is still to come
}

/// Steps of 10 ms, of a clock that a run moves.
class Tick final : public Observer {
 public:
  explicit Tick(Hands& hands) : hands_(hands) {}
  void after_step(int, Trainer&) override { hands_.now += 0.01; }

 private:
  Hands& hands_;
};

/// A run of 250 steps, watched by f(step) before each look.
class LiveRun : public ::testing::Test {
 protected:
  class Watcher final : public Observer {
   public:
    explicit Watcher(std::function<void(int)> f) : f_(std::move(f)) {}
    void after_step(int step, Trainer&) override { f_(step); }

   private:
    std::function<void(int)> f_;
  };

  void run(const std::function<void(int)>& watch) {
    Watcher watcher(watch);
    Tick tick(hands_);
    for (Observer* observer :
         std::initializer_list<Observer*>{&evaluations_, &metrics_, &tick, &watcher, &view_})
      trainer_.add_observer(*observer);
    view_.follow(metrics_, evaluations_);
    trainer_.run();
  }

  TempFolder temp_;
  Hands hands_;
  Scene scene_ = small_scene();
  Config config_ = short_run();
  std::unique_ptr<Backend> backend_ = make_scalar_backend();
  Trainer trainer_{scene_, config_, *backend_};
  LiveView view_{"a run", scene_, config_, hands_.clock()};
  RunFolder folder_{temp_.path()};
  ProgressObserver progress_{250, false};
  EvaluationObserver evaluations_{progress_};
  MetricsObserver metrics_{folder_, evaluations_};
};

TEST_F(LiveRun, IsNotLookedAtWhileNobodyWatches) {
  run([](int) {});
  EXPECT_EQ(view_.looks(), 0);
  view_.end({}, {});
  const Json state = view_.state();
  EXPECT_EQ(state.at("version"), 0);
  EXPECT_EQ(state.at("step"), 250);
  EXPECT_EQ(state.at("done"), true);
  EXPECT_FALSE(view_.mode_and_model().contains("model"));
  EXPECT_EQ(view_.model().status, 404);
}

TEST_F(LiveRun, IsNoLongerLookedAtWhenTheWatcherIsGone) {
  int at_last_question = 0;
  run([&](int step) {
    if (step > 100) return;
    view_.state();
    at_last_question = view_.looks();
  });
  // Looks cost nothing by this clock, so each step of those with a watcher, and of 5 s after, may have one: but for those that
  // the encoder was busy in.
  EXPECT_GT(at_last_question, 0);
  EXPECT_LE(view_.looks(), 250);
  const int looks = view_.looks();
  hands_.now += LookBudget::kWatchSeconds + 0.01;
  view_.after_step(250, trainer_);
  EXPECT_EQ(view_.looks(), looks);
}

TEST_F(LiveRun, ShowsWhatWasLogged) {
  Json state;
  run([&](int step) {
    state = view_.state();
    EXPECT_LE(state.at("step"), step);
    if (step <= config_.train.log_every) {
      EXPECT_TRUE(state.at("loss").is_null());
    }
  });
  EXPECT_GT(state.at("loss"), 0.0);
  EXPECT_EQ(state.at("steps"), 250);
  EXPECT_GT(state.at("gaussians"), 0);
  EXPECT_TRUE(state.at("psnr").is_null());
}

TEST_F(LiveRun, EndsWithTheModelItWasGiven) {
  run([](int) {});
  view_.end(trained_model(trainer_), {});
  EXPECT_EQ(view_.state().at("version"), 1);
  const Json model = view_.mode_and_model().at("model");
  const auto file = temp_.path() / ("model." + model.at("format").get<std::string>());
  write_bytes(file, *view_.model().body);
  const GaussianModel shown = read_model(file), trained = trained_model(trainer_);
  EXPECT_EQ(model.at("bytes"), view_.model().body->size());
  ASSERT_EQ(shown.gaussians.count(), trained.gaussians.count());
  double sum_shown = 0, sum_trained = 0;  // whatever the order of rows
  for (std::size_t i = 0; i < shown.gaussians.count(); ++i) {
    sum_shown += shown.gaussians.mean[i].x;
    sum_trained += trained.gaussians.mean[i].x;
  }
  EXPECT_NEAR(sum_shown, sum_trained, 1e-2 * double(shown.gaussians.count()));
}

TEST_F(LiveRun, SaysThatItWentBack) {
  run([](int) {});
  view_.after_rollback(100, trainer_);
  const Json state = view_.state();
  EXPECT_EQ(state.at("step"), 100);
  EXPECT_THAT(state.at("message").get<std::string>(), ::testing::HasSubstr("after step 100"));
}

// --- Frame

TEST(ViewFrame, IsAroundWhatCamerasLookAt) {
  std::vector<ViewedCamera> cameras;
  for (int k = 0; k < 8; ++k) {
    Camera camera = orbit_camera(0.785f * float(k));
    // The orbit's center is the origin; it is moved to (5, 6, 7).
    camera.cam_from_world_translation -= multiply(camera.cam_from_world_rotation, Vec3f(5, 6, 7));
    cameras.push_back({"", "", camera});
  }
  const Vec3f far{100, 100, 100};
  const SceneFrame frame = frame_of(cameras, {&far, 1});
  EXPECT_NEAR(frame.center.x, 5, 4);  // drawn to the only point a little
  EXPECT_NEAR(frame.up.y, -1, 1e-6);
  const Vec3f near{5, 6, 7};
  const SceneFrame exact = frame_of(cameras, {&near, 1});
  EXPECT_NEAR(exact.center.x, 5, 1e-4);
  EXPECT_NEAR(exact.center.y, 6, 1e-4);
  EXPECT_NEAR(exact.center.z, 7, 1e-4);
  EXPECT_NEAR(exact.radius, 3, 1e-3);
}

TEST(ViewFrame, OfParallelCamerasIsWhereThePointsAre) {
  std::vector<ViewedCamera> cameras;
  for (int k = 0; k < 5; ++k) {
    Camera camera = orbit_camera(0);
    camera.cam_from_world_translation = {-0.1f * float(k), 0, 0};
    cameras.push_back({"", "", camera});
  }
  const std::vector<Vec3f> points{{0, 0, 3}, {0.2f, 0, 4}, {0.4f, 0, 5}, {NAN, 0, 0}};
  const SceneFrame frame = frame_of(cameras, {points.data(), points.size()});
  EXPECT_NEAR(frame.center.z, 4, 1e-3);
  EXPECT_NEAR(frame.center.x, 0.2, 1e-3);
}

TEST(ViewFrame, WithoutCamerasIsThatOfThePoints) {
  const std::vector<Vec3f> points{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}};
  const SceneFrame frame = frame_of({}, {points.data(), points.size()});
  EXPECT_EQ(frame.center.x, 2);
  EXPECT_NEAR(frame.radius, 2, 1);
  EXPECT_EQ(frame.up.y, -1);
  EXPECT_GT(frame_of({}, {}).radius, 0);
}

}  // namespace
}  // namespace gs
