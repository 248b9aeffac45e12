// SPDX-License-Identifier: Apache-2.0
// A run that is paused, saved and stopped by requests, and what it learns meanwhile.
#include "gs_app/view/run_control.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "gs_core/system/text/json.h"
#include "gs_model/formats/formats.h"
#include "tests/support/small_scene.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

HttpRequest asking(const std::string& word, const std::string& token) {
  HttpRequest request;
  request.method = "POST";
  request.path = "/control";
  request.query["do"] = word;
  request.token = token;
  return request;
}

/// A run of 250 steps; at(step) is called in each, before the control's own turn.
class ControlledRun : public ::testing::Test {
 protected:
  class At final : public Observer {
   public:
    explicit At(std::function<void(int)> f) : f_(std::move(f)) {}
    void after_step(int step, Trainer&) override { f_(step); }

   private:
    std::function<void(int)> f_;
  };

  int ask(const std::string& word) {
    return control_.answer(asking(word, control_.token())).status;
  }

  GaussianModel run(const std::function<void(int)>& at) {
    const auto backend = make_scalar_backend();
    Trainer trainer(scene_, config_, *backend);
    At observer(at);
    trainer.add_observer(observer);
    trainer.add_observer(control_);
    trainer.run();
    step_ = trainer.step();
    return trained_model(trainer);
  }

  void wait_for_pauses(int count) {
    while (pauses_ < count) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  TempFolder temp_;
  RunFolder folder_{temp_.path()};
  Scene scene_ = small_scene();
  Config config_ = short_run();
  std::atomic<int> pauses_ = 0;
  RunControl control_{folder_, [this](Trainer&) { ++pauses_; }};
  int step_ = 0;
};

void expect_same(const GaussianModel& a, const GaussianModel& b, const TempFolder& temp) {
  write_model(temp.path() / "a.ply", a);
  write_model(temp.path() / "b.ply", b);
  EXPECT_EQ(read_bytes(temp.path() / "a.ply"), read_bytes(temp.path() / "b.ply"));
}

TEST_F(ControlledRun, LearnsTheSameWhetherItWasPausedAndSavedOrNot) {
  const GaussianModel plain = [&] {
    const auto backend = make_scalar_backend();
    Trainer trainer(scene_, config_, *backend);
    trainer.run();
    return trained_model(trainer);
  }();
  std::thread person([&] {
    for (const int pause : {1, 2}) {
      wait_for_pauses(pause);
      EXPECT_TRUE(SortedJson(control_.state()).at("paused"));
      EXPECT_EQ(ask("save"), 200);
      while (SortedJson(control_.state()).at("saving")) std::this_thread::yield();
      EXPECT_EQ(ask("resume"), 200);
    }
  });
  const GaussianModel paused = run([&](int step) {
    if (step == 40 || step == 120) {
      EXPECT_EQ(ask("pause"), 200);
    }
  });
  person.join();
  EXPECT_EQ(step_, 250);
  expect_same(plain, paused, temp_);
}

TEST_F(ControlledRun, WaitsWhileItIsPaused) {
  std::atomic<int> last = 0;
  std::thread person([&] {
    wait_for_pauses(1);
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    EXPECT_EQ(last, 30);
    EXPECT_EQ(ask("resume"), 200);
  });
  run([&](int step) {
    last = step;
    if (step == 30) ask("pause");
  });
  person.join();
  EXPECT_EQ(last, 250);
}

TEST_F(ControlledRun, SavesTheModelOfTheStepAtHand) {
  SortedJson state;
  run([&](int step) {
    if (step == 50) ask("save");
    if (step == 51) state = control_.state();
  });
  EXPECT_EQ(state.at("saved"), 50);
  EXPECT_FALSE(state.at("saving"));
  EXPECT_GT(read_model(folder_.ply(50)).gaussians.count(), 0u);
}

TEST_F(ControlledRun, GoesOnWhereTheModelCannotBeSaved) {
  write_bytes(temp_.path() / "point_cloud", "a file where a folder should be");
  run([&](int step) {
    if (step == 50) ask("save");
  });
  EXPECT_EQ(step_, 250);
  EXPECT_TRUE(SortedJson(control_.state()).at("saved").is_null());
  EXPECT_THAT(SortedJson(control_.state()).at("trouble").get<std::string>(),
              ::testing::HasSubstr("not saved"));
}

TEST_F(ControlledRun, StopsEarlyAlsoWhileItIsPaused) {
  std::thread person([&] {
    wait_for_pauses(1);
    EXPECT_EQ(ask("stop"), 200);
  });
  run([&](int step) {
    if (step == 60) ask("pause");
  });
  person.join();
  EXPECT_GE(step_, 60);
  EXPECT_LT(step_, 250);
  EXPECT_TRUE(control_.was_stopped());
}

TEST_F(ControlledRun, EndsWhereItIsPausedInItsLastStep) {
  run([&](int step) {
    if (step == 250) ask("pause");
  });
  EXPECT_EQ(step_, 250);
}

TEST_F(ControlledRun, RefusesThoseWithoutTheTokenAndOtherWords) {
  EXPECT_EQ(control_.token().size(), 32u);
  EXPECT_NE(control_.token(), RunControl(folder_).token());
  for (const std::string& token : {std::string(), std::string(32, '0'), control_.token() + "0"})
    EXPECT_EQ(control_.answer(asking("stop", token)).status, 403) << token;
  EXPECT_EQ(ask("explode"), 400);
  EXPECT_FALSE(SortedJson(control_.state()).at("stopping"));
}

TEST_F(ControlledRun, RefusesEverythingWhenItIsOver) {
  run([](int) {});
  EXPECT_EQ(ask("pause"), 409);
}

}  // namespace
}  // namespace gs
