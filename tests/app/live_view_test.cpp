// SPDX-License-Identifier: Apache-2.0
// The cost of the viewer for a run, measured by a clock that the test sets; the losses of a run;
// and the first view.
#include "gs_app/view/live_view.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/formats.h"
#include "gs_train/poses/poses.h"
#include "tests/support/small_scene.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

/// A clock that the test sets.
struct Hands {
  double now = 1000;
  SnapshotBudget::Clock clock() {
    return [this] { return now; };
  }
};

TEST(SnapshotBudget, AllowsACopyOnlyWithinFiveSecondsOfAPoll) {
  Hands hands;
  SnapshotBudget budget(hands.clock());
  EXPECT_FALSE(budget.allows_copy());
  budget.note_poll();
  EXPECT_TRUE(budget.allows_copy());
  hands.now += SnapshotBudget::kWatchSeconds + 0.01;
  EXPECT_FALSE(budget.allows_copy()) << "the page is gone";
  budget.note_poll();
  EXPECT_TRUE(budget.allows_copy());
}

TEST(SnapshotBudget, ACopyIsFollowedByAPauseAHundredTimesAsLong) {
  Hands hands;
  SnapshotBudget budget(hands.clock());
  budget.spend([&] { hands.now += 0.2; });
  hands.now += 19.9;
  budget.note_poll();
  EXPECT_FALSE(budget.allows_copy());
  hands.now += 0.2;
  EXPECT_TRUE(budget.allows_copy());
}

TEST(SnapshotBudget, CopiesTakeAtMostAHundredthOfTheTimeWhateverTheyCost) {
  Hands hands;
  SnapshotBudget budget(hands.clock());
  const double begin = hands.now;
  Draws draws(1);
  double spent = 0, last = 0;
  for (int step = 0; step < 200'000; ++step) {
    hands.now += 0.01;
    budget.note_poll();
    if (!budget.allows_copy()) continue;
    last = draws.log_uniform(0.001f, 2.0f);
    budget.spend([&] { hands.now += last; });
    spent += last;
  }
  EXPECT_GT(spent, 0);
  EXPECT_LE(spent - last, (hands.now - begin) / 100);  // the pause after the last one is not over
}

/// Moves the clock by 10 ms in each step of a run.
class Tick final : public Observer {
 public:
  explicit Tick(Hands& hands) : hands_(hands) {}
  void after_step(int, Trainer&) override { hands_.now += 0.01; }

 private:
  Hands& hands_;
};

/// A run of 250 steps. watch(step) is called in each, before the LiveView's own after_step().
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
  LostWrites lost_;
  MetricsObserver metrics_{folder_, evaluations_, lost_};
};

TEST_F(LiveRun, IsNotCopiedWhileNoPagePolls) {
  run([](int) {});
  EXPECT_EQ(view_.copies(), 0);
  view_.end({}, {});
  const SortedJson state = view_.state(-1);
  EXPECT_EQ(state.at("version"), 0);
  EXPECT_EQ(state.at("step"), 250);
  EXPECT_EQ(state.at("done"), true);
  EXPECT_FALSE(view_.mode_and_model().contains("model"));
  EXPECT_EQ(view_.model().status, 404);
}

TEST_F(LiveRun, IsNotCopiedAnyMoreAfterThePageIsGone) {
  int at_last_poll = 0;
  run([&](int step) {
    if (step > 100) return;
    view_.state(-1);
    at_last_poll = view_.copies();
  });
  // Copies cost nothing by this clock, so every step up to 5 s after the last poll may have one,
  // unless the encoder is busy.
  EXPECT_GT(at_last_poll, 0);
  EXPECT_LE(view_.copies(), 250);
  const int copies = view_.copies();
  hands_.now += SnapshotBudget::kWatchSeconds + 0.01;
  view_.after_step(250, trainer_);
  EXPECT_EQ(view_.copies(), copies);
}

TEST_F(LiveRun, ShowsWhatWasLogged) {
  SortedJson state;
  run([&](int step) {
    state = view_.state(-1);
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

TEST_F(LiveRun, SendsTheLossesFromTheFirstStepOnAndEachOnce) {
  run([](int) {});
  const SortedJson all = view_.state(-1).at("losses");  // of a page that is opened at the end
  ASSERT_EQ(all.size(), metrics_.losses().size());
  ASSERT_EQ(all.size(), 2u);  // of 250 steps, a row every 100
  EXPECT_EQ(all.at(0).at(0), config_.train.log_every);
  EXPECT_EQ(all.at(0).at(1), metrics_.losses()[0].loss);
  const int newest = all.back().at(0);
  EXPECT_TRUE(view_.state(newest).at("losses").empty());
  EXPECT_EQ(view_.state(newest - 1).at("losses"), Json::array({all.back()}));
}

TEST_F(LiveRun, TakesBackTheLossesOfARolledBackRun) {
  run([](int) {});
  const int first = view_.state(-1).at("losses").at(0).at(0);
  metrics_.after_rollback(first, trainer_);
  view_.after_rollback(first, trainer_);
  EXPECT_EQ(view_.state(-1).at("losses").size(), 1u);
}

TEST(LiveRunThatRefinesPoses, ShowsThePosesThatItHas) {
  const Scene scene = small_scene();
  Config config = short_run();
  config.poses.refine = true;
  config.poses.rate = 0.01f;
  const auto backend = make_scalar_backend();
  Trainer trainer(scene, config, *backend);
  LiveView view("a run", scene, config);
  EXPECT_FALSE(view.mode_and_model().contains("cameras"));
  trainer.add_observer(view);
  trainer.run();
  const SortedJson cameras = view.mode_and_model().at("cameras");
  ASSERT_EQ(cameras.size(), scene.train_views.size());
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const Camera now = refined_camera(trainer.model().poses, scene.train_views[i].camera, i);
    EXPECT_NEAR(cameras[i].at("world_from_camera")[3], now.position().x, 1e-5);
    EXPECT_EQ(cameras[i].at("name"), scene.train_views[i].name);
    EXPECT_GT(std::abs(now.position().x - scene.train_views[i].camera.position().x), 1e-6f);
  }
}

TEST_F(LiveRun, EndsWithTheModelItWasGiven) {
  run([](int) {});
  view_.end(trained_model(trainer_), {});
  EXPECT_EQ(view_.state(-1).at("version"), 1);
  const SortedJson model = view_.mode_and_model().at("model");
  const auto file = temp_.path() / ("model." + model.at("format").get<std::string>());
  write_bytes(file, *view_.model().body);
  const GaussianModel shown = read_model(file), trained = trained_model(trainer_);
  EXPECT_EQ(model.at("bytes"), view_.model().body->size());
  ASSERT_EQ(shown.gaussians.count(), trained.gaussians.count());
  double sum_shown = 0, sum_trained = 0;  // the rows are in another order
  for (std::size_t i = 0; i < shown.gaussians.count(); ++i) {
    sum_shown += shown.gaussians.mean[i].x;
    sum_trained += trained.gaussians.mean[i].x;
  }
  EXPECT_NEAR(sum_shown, sum_trained, 1e-2 * double(shown.gaussians.count()));
}

TEST_F(LiveRun, ReportsARollback) {
  run([](int) {});
  view_.after_rollback(100, trainer_);
  const SortedJson state = view_.state(-1);
  EXPECT_EQ(state.at("step"), 100);
  EXPECT_THAT(state.at("message").get<std::string>(), ::testing::HasSubstr("after step 100"));
}

TEST_F(LiveRun, SaysThatItWasStoppedAfterItsLastPoll) {
  run([&](int step) {
    if (step == 60) trainer_.stop();
  });
  view_.say("The run was stopped.");
  view_.end(trained_model(trainer_), {});
  const SortedJson state = view_.state(-1);
  EXPECT_EQ(state.at("message"), "The run was stopped.");
  EXPECT_EQ(state.at("stopped"), true);
  EXPECT_EQ(state.at("done"), true);
  EXPECT_EQ(state.at("version"), 1);
}

TEST(LiveRunOfAFolder, TellsThisMachineAloneWhereItLies) {
  const Scene scene = small_scene();
  Config config = short_run();
  config.model.output = "runs/it's here";
  LiveView view("here", scene, config);
  const auto asked_from = [&](const std::string& client) {
    HttpRequest request;
    request.path = "/scene.json";
    request.client = client;
    return SortedJson::parse(*view_answer(view, request).body);
  };
  EXPECT_EQ(asked_from("127.0.0.1").at("path"), "runs/it's here");
  EXPECT_EQ(asked_from("127.0.0.1").at("title"), "here");
  EXPECT_FALSE(asked_from("192.168.0.7").contains("path"));
}

// --- Frame

TEST(ViewFrame, IsCenteredWhereTheCamerasLook) {
  std::vector<ViewedCamera> cameras;
  for (int k = 0; k < 8; ++k) {
    Camera camera = orbit_camera(0.785f * float(k));
    // The orbit's center is the origin; it is moved to (5, 6, 7).
    camera.cam_from_world_translation -= multiply(camera.cam_from_world_rotation, Vec3f(5, 6, 7));
    cameras.push_back({"", "", camera});
  }
  const Vec3f far{100, 100, 100};
  const SceneFrame frame = frame_of(cameras, {&far, 1});
  EXPECT_NEAR(frame.center.x, 5, 4);  // the only point pulls the center a little
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
