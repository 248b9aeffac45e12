// SPDX-License-Identifier: Apache-2.0
// TrainSession in the test's own process: the ways in which it ends, memory that runs out after the
// last step, and starts from a model.
#include "gs_app/session/train_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <thread>

#include "gs_app/export/export_model.h"
#include "gs_core/error.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/memory.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_eval/metrics.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/model_info.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/captured_log.h"
#include "tests/support/error_of.h"
#include "tests/support/models.h"
#include "tests/support/small_scene.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// Calls a function after each step, and another one when the run is over.
class Watcher final : public Observer {
 public:
  std::function<void(int, Trainer&)> on_step = [](int, Trainer&) {};
  std::function<void()> on_end = [] {};
  void after_step(int step, Trainer& trainer) override { on_step(step, trainer); }
  void after_run(Trainer&) override { on_end(); }
};

class TestHooks final : public SessionHooks {
 public:
  Watcher watcher;
  std::function<void(Trainer&)> at_start = [](Trainer&) {};
  std::function<void()> at_evaluation = [] {};
  void use_threads(int) override {}
  void show_evaluation(std::size_t done, std::size_t) override {
    if (done == 0) at_evaluation();
  }
  void before_training(Trainer& trainer, const MetricsObserver&,
                       const EvaluationObserver&) override {
    at_start(trainer);
    trainer.add_observer(watcher);
  }
};

/// While it lives, allocations fail until `count` of them have failed.
class FailingMemory {
 public:
  explicit FailingMemory(int count) {
    left_ = count;
    set_allocation_hook(fail);
  }
  ~FailingMemory() { set_allocation_hook(nullptr); }

 private:
  static void fail(std::size_t) {
    if (left_-- > 0) throw Error("out of memory on purpose", ExitCode::out_of_memory);
  }
  static inline int left_ = 0;
};

class Session : public ::testing::Test {
 protected:
  fs::path path(const std::string& name) const { return folder_.path() / name; }

  // A run of 20 steps; every fourth step has a checkpoint.
  TrainRequest request(const std::string& out, const std::string& start_from = "") const {
    TrainRequest request;
    request.settings = [=, this](const Config& start) {
      Config config = start;
      config.train.iterations = 20;
      config.train.checkpoint_every = 4;
      config.train.log_every = 5;
      config.train.device = "cpu";
      config.model.output = path(out).string();
      if (!start_from.empty()) config.model.start_from = start_from;
      return config;
    };
    request.scene = &scene_;
    request.shows_progress = false;
    request.stops_on_signal = false;
    request.writes_report = false;
    return request;
  }
  // The same with Gaussians in space and time, on a scene whose first photo was taken later.
  TrainRequest moving_request(const std::string& out, const std::string& start_from = "") {
    TrainRequest moving = request(out, start_from);
    moving.settings = [settings = moving.settings](const Config& start) {
      Config config = settings(start);
      config.model.dynamic = true;
      return config;
    };
    scene_.train_views.front().camera.time = 1;
    scene_.time_count = 2;
    return moving;
  }
  std::string error_of_run(const TrainRequest& request) {
    return error_of([&] { run(request); });
  }
  fs::path ply(const std::string& out, int step = 20) const {
    return RunFolder(path(out)).ply(step);
  }
  SessionEnd run(const TrainRequest& request) {
    TestHooks hooks;
    return TrainSession(request, hooks).run();
  }

  Scene scene_ = small_scene();
  TempFolder folder_;
};

TEST_F(Session, PanoramasGetTheAdviceOfAFilterThatTheyDoNotHave) {
  scene_.train_views.front().panorama = [] { return View(); };
  TestHooks hooks;
  hooks.at_start = [](Trainer&) { throw Error("enough"); };
  const auto log_of = [&](const TrainRequest& request) {
    CapturedLog logged;
    EXPECT_THROW(TrainSession(request, hooks).run(), Error);
    return logged.text();
  };
  TrainRequest plain = request("plain"), filtered = request("filtered");
  filtered.settings = [settings = plain.settings, this](const Config& start) {
    Config config = settings(start);
    config.model.filter_3d = true;
    config.model.output = path("filtered").string();
    return config;
  };
  EXPECT_THAT(log_of(plain), HasSubstr("--filter-3d --antialiased"));
  EXPECT_THAT(log_of(filtered), Not(HasSubstr("--filter-3d")));
}

TEST_F(Session, AFinishedRunHasItsFilesAndResults) {
  TestHooks hooks;
  TrainSession session(request("out"), hooks);
  ASSERT_EQ(session.run(), SessionEnd::finished);
  EXPECT_EQ(session.results().iterations, 20);
  EXPECT_TRUE(session.results().train.views.empty());  // nobody asked for figures
  for (const char* name : {"config.toml", "metrics.csv", "results.json", "comparison.png",
                           "train/ours_20/renders/00007.png", "checkpoints/step_20.ckpt"})
    EXPECT_TRUE(fs::exists(path("out") / name)) << name;
  EXPECT_TRUE(fs::exists(ply("out")));
  EXPECT_FALSE(fs::exists(path("out/report.html")));
}

TEST_F(Session, ResultsSayWhereAllTimeWent) {
  TestHooks hooks;
  TrainRequest asked = request("out");
  const auto begin = WallClock::Clock::now();
  asked.begin = begin - std::chrono::seconds(100);
  ASSERT_EQ(TrainSession(asked, hooks).run(), SessionEnd::finished);
  const double wall = std::chrono::duration<double>(WallClock::Clock::now() - begin).count();
  const auto results = SortedJson::parse(read_bytes(path("out/results.json")));
  double sum = 0;
  for (const auto& [part, seconds] : results.at("wall_seconds").items()) {
    EXPECT_GE(seconds.get<double>(), 0) << part;
    sum += seconds.get<double>();
  }
  EXPECT_GT(results.at("wall_seconds").at("start"), 100);
  EXPECT_NEAR(results.at("wall_seconds").at("training").get<double>(),
              results.at("train_seconds").get<double>(), 1e-4);
  EXPECT_GT(sum, 100 + 0.5 * wall);
  EXPECT_LE(sum, 100 + wall);
}

TEST_F(Session, ARunWithDepthMapsSaysHowFarDepthIsOff) {
  View& view = scene_.train_views[0];
  view.depth = ImageF(view.camera.width, view.camera.height, 1, 3);
  view.has_depth_map = true;
  scene_.test_views = {view};
  scene_.test_views[0].name = "held out";
  TestHooks hooks;
  TrainSession session(request("out"), hooks);
  ASSERT_EQ(session.run(), SessionEnd::finished);
  ASSERT_TRUE(session.results().test.depth_error);
  EXPECT_GT(*session.results().test.depth_error, 0);
  EXPECT_EQ(session.results().train.views[0].depth_error, session.results().train.depth_error);
  EXPECT_FALSE(session.results().train.views[1].depth_error);
  for (const char* name : {"results.json", "per_view.json"})
    EXPECT_THAT(read_bytes(path("out") / name), HasSubstr("\"depth_error\": 0.")) << name;
}

TEST_F(Session, ARunOnPanoramasMeasuresThemWhole) {
  scene_.test_views = {scene_.train_views[0]};
  scene_.test_views[0].panorama = [] { return View{"", {}, Image8(32, 16, 3, 255)}; };
  TestHooks hooks;
  TrainSession session(request("out"), hooks);
  ASSERT_EQ(session.run(), SessionEnd::finished);
  for (const char* name : {"results.json", "per_view.json"}) {
    const Json test = Json::parse(read_bytes(path("out") / name)).at("test");
    const Json& figures = test.contains("psnr") ? test : *test.begin();
    for (const char* key : {"psnr_panorama", "ws_psnr"}) EXPECT_GT(figures.at(key), 0) << name;
    EXPECT_LT(figures.at("ssim_panorama"), 1) << name;
  }
}

TEST_F(Session, ARunWhoseCamerasLookAwayDoesNotStart) {
  for (View& view : scene_.train_views) view.camera.cam_from_world_translation.z *= -1;
  try {
    run(request("out"));
    FAIL() << "it trained on empty pictures";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("every picture would be empty"),
                                    HasSubstr("behind them; check the poses")));
  }
  EXPECT_FALSE(fs::exists(path("out")));
}

TEST_F(Session, ARunThatSeesNothingInItsFirst100StepsSaysSo) {
  const auto warnings_of = [&](const std::string& out, MomentStorage moments) {
    TrainRequest longer = request(out);
    longer.settings = [settings = longer.settings, moments](const Config& start) {
      Config config = settings(start);
      config.train.iterations = 110;
      config.optimizer.moments = moments;
      return config;
    };
    const CapturedLog log;
    EXPECT_EQ(run(longer), SessionEnd::finished);
    return log.text();
  };
  const std::string warning = "step 100: no view has shown any Gaussian";
  EXPECT_THAT(warnings_of("seeing", MomentStorage::floats), Not(HasSubstr(warning)));
  EXPECT_THAT(warnings_of("seeing_tiny", MomentStorage::halves), Not(HasSubstr(warning)));
  // The points are between the planes, and far beside the pictures.
  for (View& view : scene_.train_views) view.camera.cam_from_world_translation.y += 1000;
  EXPECT_THAT(warnings_of("blind", MomentStorage::floats), HasSubstr(warning));
  EXPECT_THAT(warnings_of("blind_tiny", MomentStorage::halves), HasSubstr(warning));
}

TEST_F(Session, AStoppedRunIsSavedAndGoesOnToTheSameBytes) {
  ASSERT_EQ(run(request("whole")), SessionEnd::finished);
  TestHooks hooks;
  hooks.watcher.on_step = [](int step, Trainer& trainer) {
    if (step == 6) trainer.stop();
  };
  TrainRequest asked = request("out");
  ASSERT_EQ(TrainSession(asked, hooks).run(), SessionEnd::stopped);
  EXPECT_TRUE(fs::exists(ply("out", 7)));
  EXPECT_FALSE(fs::exists(path("out/results.json")));
  asked.resume = "auto";
  ASSERT_EQ(run(asked), SessionEnd::finished);
  EXPECT_TRUE(read_bytes(ply("out")) == read_bytes(ply("whole")));
  EXPECT_EQ(run(asked), SessionEnd::nothing_left);
}

TEST_F(Session, ARunOfSoManyPassesKeepsItsNumbersWhenItIsResumed) {
  TrainRequest asked = request("out");
  asked.settings = [settings = asked.settings](const Config& start) {
    Config config = settings(start);
    config.train.iterations = 0;
    config.train.epochs = 2;  // of 8 photos
    config.train.least_iterations = 1;
    config.density.gaussians_per_point = 3;
    config.density.pixels_per_gaussian = 0;
    return config;
  };
  TestHooks hooks;
  hooks.watcher.on_step = [](int step, Trainer& trainer) {
    if (step == 6) trainer.stop();
  };
  ASSERT_EQ(TrainSession(asked, hooks).run(), SessionEnd::stopped);
  Config written;
  load_config(written, path("out/config.toml"));
  EXPECT_EQ(written.train.iterations, 16);
  EXPECT_EQ(written.density.max_gaussians, std::int64_t(3 * scene_.points.size()));
  asked.resume = "auto";
  ASSERT_EQ(run(asked), SessionEnd::finished);
  EXPECT_TRUE(fs::exists(ply("out", 16)));
  EXPECT_EQ(run(asked), SessionEnd::nothing_left);
}

TEST_F(Session, MemoryThatRunsOutWhileTheModelIsSavedIsGivenBackAndTheModelSaved) {
  std::optional<FailingMemory> failing;
  TestHooks hooks;
  hooks.watcher.on_end = [&] { failing.emplace(1); };
  ASSERT_EQ(TrainSession(request("out"), hooks).run(), SessionEnd::finished);
  EXPECT_TRUE(fs::exists(ply("out")));
}

TEST_F(Session, MemoryThatIsGoneForGoodAfterTheLastStepNamesTheCheckpoint) {
  std::optional<FailingMemory> failing;
  TestHooks hooks;
  hooks.watcher.on_end = [&] { failing.emplace(1 << 30); };
  TrainSession session(request("out"), hooks);
  try {
    session.run();
    FAIL() << "it went on";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::out_of_memory);
    EXPECT_THAT(error.what(), AllOf(HasSubstr("saving the model"), HasSubstr("step_20.ckpt"),
                                    HasSubstr("--resume")));
  }
}

TEST_F(Session, MemoryThatRunsOutInTheEvaluationNamesTheModel) {
  const fs::path model = ply("out");
  static const std::thread::id kHere = std::this_thread::get_id();  // others write the model
  TestHooks hooks;
  hooks.at_evaluation = [] {
    set_allocation_hook([](std::size_t) {
      if (std::this_thread::get_id() == kHere)
        throw Error("out of memory on purpose", ExitCode::out_of_memory);
    });
  };
  const struct Reset {
    ~Reset() { set_allocation_hook(nullptr); }
  } reset;
  try {
    TrainSession(request("out"), hooks).run();
    FAIL() << "it went on";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::out_of_memory);
    EXPECT_THAT(error.what(), AllOf(HasSubstr("the evaluation"), HasSubstr(model.string())));
  }
  EXPECT_TRUE(fs::exists(model));
}

/// Files whose path has `part` in it cannot be written while it lives.
class FullDisk : public WriteHook {
 public:
  explicit FullDisk(std::string part) : part_(std::move(part)) { set_write_hook(this); }
  ~FullDisk() override { set_write_hook(nullptr); }
  void before(WritePoint point, const fs::path& file) override {
    if (point == WritePoint::write && file.string().find(part_) != std::string::npos)
      throw Error("cannot write " + file.string() + ": the disk is full, says the test");
  }

 private:
  std::string part_;
};

TEST_F(Session, AModelThatCannotBeWrittenIsNamedWithTheCheckpointToGoOnFrom) {
  const FullDisk full("iteration_20");
  EXPECT_THAT(error_of_run(request("out")),
              AllOf(HasSubstr("iteration_20"), HasSubstr("step_20.ckpt"), HasSubstr("--resume")));
  EXPECT_FALSE(fs::exists(path("out/results.json")));
}

TEST_F(Session, AFullDiskAtASaveStepCostsThatModelAndIsSaidAgainAtTheEnd) {
  TrainRequest asked = request("out");
  const SettingsOver settings = asked.settings;
  asked.settings = [=](const Config& start) {
    Config config = settings(start);
    config.train.save_steps = {8, 12};
    return config;
  };
  const FullDisk full("iteration_8");
  CapturedLog logged;
  EXPECT_EQ(run(asked), SessionEnd::finished);
  const std::string& log = logged.text();
  EXPECT_FALSE(fs::exists(ply("out", 8)));
  EXPECT_TRUE(fs::exists(ply("out", 12)));
  EXPECT_TRUE(fs::exists(ply("out")));
  EXPECT_THAT(log, HasSubstr("the model of step 8 could not be written"));
  EXPECT_THAT(log.substr(log.find("now it is evaluated")),
              HasSubstr("the model of step 8 is missing"));
}

TEST_F(Session, RowsWithoutAPlaceOnTheDiskComeWithALaterOne) {
  LostWrites lost;
  GrowingCsv file(path("a.csv"), "step,loss\n", "1,0.5\n", lost);
  fs::remove(path("a.csv"));
  fs::create_symlink("/dev/full", path("a.csv"));
  file.add("2,0.4\n");
  file.add("3,0.3\n");
  CapturedLog logged;
  lost.say_again();
  EXPECT_THAT(logged.text(), HasSubstr("a.csv is missing"));
  fs::remove(path("a.csv"));
  write_bytes(path("a.csv"), "step,loss\n1,0");  // half of a row
  file.add("4,0.2\n");
  EXPECT_EQ(read_bytes(path("a.csv")), "step,loss\n1,0.5\n2,0.4\n3,0.3\n4,0.2\n");
  file.cut_after(2);
  file.add("3,0.1\n");
  EXPECT_EQ(read_bytes(path("a.csv")), "step,loss\n1,0.5\n2,0.4\n3,0.1\n");
  CapturedLog logged_again;
  lost.say_again();
  EXPECT_EQ(logged_again.text(), "");
}

TEST_F(Session, AnOlderSidecarIsNeverBesideANewerFile) {
  /// Ends the export right before or right after the file has its name.
  class StopAt : public WriteHook {
   public:
    StopAt(WritePoint point, fs::path file) : point_(point), file_(std::move(file)) {
      set_write_hook(this);
    }
    ~StopAt() override { set_write_hook(nullptr); }
    void before(WritePoint point, const fs::path& file) override {
      if (point == point_ && file == file_) throw Error("stopped by the test");
    }

   private:
    WritePoint point_;
    fs::path file_;
  };
  GaussianModel model{small_truth(), 0, true, false, {0.0, 0.0, 0.0}};
  const ExportRequest request{path("a.splat")};
  export_model(model, request);
  const std::string file = read_bytes(request.file), sidecar = read_bytes(sidecar_of(request.file));
  model.world_offset = {2.27, 0, 0};
  model.gaussians.mean[0].x += 1;
  {
    const StopAt before(WritePoint::rename, request.file);
    EXPECT_THROW(export_model(model, request), Error);
  }
  EXPECT_EQ(read_bytes(request.file), file);
  EXPECT_EQ(read_bytes(sidecar_of(request.file)), sidecar);
  {
    const StopAt after(WritePoint::sync_folder, request.file);
    EXPECT_THROW(export_model(model, request), Error);
  }
  EXPECT_NE(read_bytes(request.file), file);
  EXPECT_FALSE(fs::exists(sidecar_of(request.file)));
  export_model(model, request);
  EXPECT_NE(read_bytes(sidecar_of(request.file)), sidecar);
}

TEST_F(Session, ARunStartsFromTheGaussiansOfAModel) {
  ASSERT_EQ(run(request("first")), SessionEnd::finished);
  const GaussianModel model = read_gaussian_ply(ply("first"));
  TestHooks hooks;
  bool has_started = false;
  hooks.at_start = [&](Trainer& trainer) {
    has_started = true;
    EXPECT_EQ(trainer.step(), 0);
    EXPECT_EQ(trainer.settings().sh_degree, 3);  // not from degree 0 again
    ASSERT_EQ(trainer.gaussian_count(), model.gaussians.count());
    const TrainingModel& state = trainer.model();
    for (std::size_t i = 0; i < state.count(); ++i) {
      EXPECT_EQ(state.gaussians.mean[i], model.gaussians.mean[i]);
      EXPECT_EQ(state.gaussians.logit_opacity[i], model.gaussians.logit_opacity[i]);
      EXPECT_TRUE(moments_are(state, i, 0));
      EXPECT_EQ(state.statistics.visits[i], 0);
    }
  };
  ASSERT_EQ(TrainSession(request("second", ply("first").string()), hooks).run(),
            SessionEnd::finished);
  EXPECT_TRUE(has_started);
  EXPECT_THAT(read_bytes(path("second/config.toml")),
              HasSubstr("start_from = \"" + ply("first").string()));
}

TEST_F(Session, ARunStartsFromEveryFormatThatIsRead) {
  ASSERT_EQ(run(request("first")), SessionEnd::finished);
  const GaussianModel model = read_gaussian_ply(ply("first"));
  int formats = 0;
  for (const ModelFormat& format : model_formats()) {
    if (!format.read || !holds(format, false)) continue;
    try {
      format.require({});
    } catch (const Error&) {
      continue;  // this build lacks a library
    }
    SCOPED_TRACE(std::string(format.name));
    const fs::path file = path("model").concat(format.ending);
    write_model(file, model);
    TestHooks hooks;
    hooks.at_start = [&](Trainer& trainer) {
      ++formats;
      EXPECT_EQ(trainer.gaussian_count(), model.gaussians.count());
      EXPECT_EQ(trainer.settings().sh_degree, read_model(file).sh_degree);
    };
    TrainRequest asked = request("from_" + std::string(format.name), file.string());
    EXPECT_EQ(TrainSession(asked, hooks).run(), SessionEnd::finished);
  }
  EXPECT_GE(formats, 4);
}

TEST_F(Session, ARunWithA3dFilterSavesTheModelWithAndWithoutItAndAnotherGoesOnFromThat) {
  const auto with_filter = [](TrainRequest asked) {
    asked.settings = [settings = asked.settings](const Config& start) {
      Config config = settings(start);
      config.model.filter_3d = true;
      return config;
    };
    return asked;
  };
  ASSERT_EQ(run(with_filter(request("first"))), SessionEnd::finished);
  const fs::path raw = RunFolder(path("first")).raw_ply(20);
  EXPECT_FALSE(is_ply_with_filter_3d(ply("first")));
  ASSERT_TRUE(is_ply_with_filter_3d(raw));
  const GaussianModel expected = read_raw_gaussian_ply(raw);
  // the run's folder or the file; with another run's filter
  for (const std::string& start : {path("first").string(), raw.string()}) {
    TestHooks hooks;
    bool has_started = false;
    hooks.at_start = [&](Trainer& trainer) {
      has_started = true;
      const Gaussians& gaussians = trainer.model().gaussians;
      ASSERT_EQ(gaussians.count(), expected.gaussians.count());
      for (std::size_t i = 0; i < gaussians.count(); ++i)
        EXPECT_EQ(gaussians.log_scale[i], expected.gaussians.log_scale[i]);
    };
    const std::string out = "second" + std::to_string(start.size());
    EXPECT_EQ(TrainSession(with_filter(request(out, start)), hooks).run(), SessionEnd::finished);
    EXPECT_TRUE(has_started);
  }
  // A run without a filter has it in its scales.
  TestHooks hooks;
  hooks.at_start = [&](Trainer& trainer) {
    EXPECT_FALSE(trainer.model().gaussians.has_filter);
    EXPECT_EQ(trainer.model().gaussians.log_scale[0],
              read_gaussian_ply(raw).gaussians.log_scale[0]);
  };
  EXPECT_EQ(TrainSession(request("plain", raw.string()), hooks).run(), SessionEnd::finished);
}

/// The camera that sees after x -> scale R x + shift what this one sees before.
Camera moved(const Camera& camera, const Mat3<float>& R, float scale, const Vec3f& shift) {
  const Mat3<float>& W = camera.cam_from_world_rotation;
  Camera result = camera;
  const auto by_turned = [&](const Vec3f& row) { return multiply(R, row); };  // row R^T
  result.cam_from_world_rotation = {by_turned(W.row0), by_turned(W.row1), by_turned(W.row2)};
  result.cam_from_world_translation =
      scale * camera.cam_from_world_translation - multiply(result.cam_from_world_rotation, shift);
  return result;
}

// Another photo is added, and COLMAP is run again: the scene has other coordinates.
TEST_F(Session, AModelOfARunIsBroughtIntoTheCoordinatesOfASceneThatWasReconstructedAnew) {
  ASSERT_EQ(run(request("first")), SessionEnd::finished);
  const GaussianModel before = read_gaussian_ply(ply("first"));
  const Mat3<float> R = rotation_matrix(Quatf{0.5f, -0.5f, 0.5f, 0.5f});
  const float scale = 2.5f;
  const Vec3f shift(3, -4, 5);
  const auto renderer = make_scalar_renderer();
  const double expected_psnr =
      evaluate(*renderer, before.gaussians.span(), scene_.train_views, {}).psnr;
  for (View& view : scene_.train_views) view.camera = moved(view.camera, R, scale, shift);
  scene_.train_views.push_back(scene_.train_views.front());
  scene_.train_views.back().name = "view 9";
  scene_.train_views.back().camera.cam_from_world_translation.z += 1;
  TestHooks hooks;
  bool has_started = false;
  hooks.at_start = [&](Trainer& trainer) {
    has_started = true;
    const Gaussians& after = trainer.model().gaussians;
    ASSERT_EQ(after.count(), before.gaussians.count());
    for (std::size_t i = 0; i < after.count(); ++i) {
      const Vec3f expected = scale * multiply(R, before.gaussians.mean[i]) + shift;
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(after.mean[i][axis], expected[axis], 1e-4f);
        EXPECT_NEAR(after.log_scale[i][axis], before.gaussians.log_scale[i][axis] + std::log(scale),
                    1e-5f);
      }
    }
    // The same pictures, so SH coefficients are turned, too.
    const std::vector<View> old_views(scene_.train_views.begin(), scene_.train_views.begin() + 8);
    EXPECT_NEAR(evaluate(*renderer, after.span(), old_views, trainer.evaluation_settings()).psnr,
                expected_psnr, 0.05);
  };
  EXPECT_EQ(TrainSession(request("second", path("first").string()), hooks).run(),
            SessionEnd::finished);
  EXPECT_TRUE(has_started);
}

TEST_F(Session, AStartWithHugeNumbersIsNamedAndNotTheScene) {
  ASSERT_EQ(run(request("first")), SessionEnd::finished);
  const auto write = [&](const std::function<void(Gaussians&, std::size_t)>& change) {
    GaussianModel model = read_gaussian_ply(ply("first"));
    for (std::size_t i = 0; i < model.gaussians.count(); ++i) change(model.gaussians, i);
    export_model(model, {path("huge.ply")});
    return request("out", path("huge.ply").string());
  };
  const std::string name = path("huge.ply").string();
  EXPECT_THAT(error_of_run(write([](Gaussians& g, std::size_t i) { g.mean[i].x = 1e30f; })),
              HasSubstr("no Gaussian to start from in " + name));
  EXPECT_THAT(error_of_run(write([](Gaussians& g, std::size_t i) { g.sh0[i].y = -1e30f; })),
              HasSubstr(name));
  EXPECT_THAT(error_of_run(write([](Gaussians& g, std::size_t i) { g.log_scale[i].z = 1e3f; })),
              HasSubstr(name));
  // Out of sight, but not huge: the model is named, too.
  EXPECT_THAT(error_of_run(write([](Gaussians& g, std::size_t i) {
                g.mean[i] = {1e7f, 3e6f, -2e6f};
              })),
              AllOf(HasSubstr("cannot start from " + name), HasSubstr("a model of this scene")));
  EXPECT_FALSE(fs::exists(path("out")));
  const CapturedLog log;
  EXPECT_EQ(run(write([](Gaussians& g, std::size_t i) {
              if (i == 0) g.mean[i].x = 1e30f;
            })),
            SessionEnd::finished);
  EXPECT_THAT(log.text(), HasSubstr("1 of "));
}

TEST_F(Session, AModelOfARunOnOtherPosesIsNoStart) {
  ASSERT_EQ(run(request("first")), SessionEnd::finished);
  for (View& view : scene_.train_views)  // photos of the same names, of another place
    view.camera.cam_from_world_translation.x += 0.5f * float(view.name.back() % 3);
  EXPECT_THAT(
      error_of_run(request("second", path("first").string())),
      AllOf(HasSubstr("8 photos"), HasSubstr("stand elsewhere"), HasSubstr("the model's PLY")));
  EXPECT_EQ(run(request("second", ply("first").string())), SessionEnd::finished);
}

TEST_F(Session, ARunFromAModelOfAHigherShDegreeKeepsToItsOwn) {
  ASSERT_EQ(run(request("first")), SessionEnd::finished);
  TrainRequest asked = request("second", ply("first").string());
  asked.settings = [settings = asked.settings](const Config& start) {
    Config config = settings(start);
    config.model.sh_degree = 1;
    return config;
  };
  TestHooks hooks;
  hooks.at_start = [](Trainer& trainer) { EXPECT_EQ(trainer.settings().sh_degree, 1); };
  ASSERT_EQ(TrainSession(asked, hooks).run(), SessionEnd::finished);
  EXPECT_EQ(read_gaussian_ply(ply("second")).sh_degree, 1);
}

TEST_F(Session, ARunFromAModelThatIsStoppedGoesOnToTheSameBytes) {
  ASSERT_EQ(run(request("first")), SessionEnd::finished);
  const std::string start = ply("first").string();
  ASSERT_EQ(run(request("whole", start)), SessionEnd::finished);
  TestHooks hooks;
  hooks.watcher.on_step = [](int step, Trainer& trainer) {
    if (step == 2) trainer.stop();
  };
  TrainRequest asked = request("out", start);
  ASSERT_EQ(TrainSession(asked, hooks).run(), SessionEnd::stopped);
  asked.resume = "auto";
  ASSERT_EQ(run(asked), SessionEnd::finished);
  EXPECT_TRUE(read_bytes(ply("out")) == read_bytes(ply("whole")));
}

TEST_F(Session, AModelOfTheOtherKindIsNoStart) {
  ASSERT_EQ(run(request("still")), SessionEnd::finished);
  ASSERT_EQ(run(moving_request("moving")), SessionEnd::finished);
  EXPECT_THAT(error_of_run(request("out", ply("moving").string())),
              AllOf(HasSubstr(ply("moving").string()), HasSubstr("add -c dynamic")));
  EXPECT_THAT(error_of_run(moving_request("out", ply("still").string())),
              HasSubstr("holds 3D Gaussians, but this run"));
  EXPECT_FALSE(fs::exists(path("out")));
  const CapturedLog log;
  EXPECT_EQ(run(moving_request("out", ply("moving").string())), SessionEnd::finished);
  EXPECT_THAT(log.text(), Not(HasSubstr("static scene")));
}

TEST_F(Session, AnExportThatHoldsNoTimeIsRefusedBeforeTraining) {
  TrainRequest asked = moving_request("out");
  asked.exports = {"ply", "splat"};
  EXPECT_THAT(error_of_run(asked), AllOf(HasSubstr("--export splat: .splat does not hold"),
                                         HasSubstr(".ply"), HasSubstr("--time T")));
  EXPECT_FALSE(fs::exists(path("out")));
}

TEST_F(Session, AResumedRunNoticesOtherTimes) {
  TestHooks hooks;
  hooks.watcher.on_step = [](int step, Trainer& trainer) {
    if (step == 5) trainer.stop();
  };
  TrainRequest asked = moving_request("out");
  ASSERT_EQ(TrainSession(asked, hooks).run(), SessionEnd::stopped);
  asked.resume = "auto";
  scene_.train_views.front().camera.time = 0.5f;
  EXPECT_THAT(error_of_run(asked), HasSubstr("has the time 0.5, not 1"));
  scene_.train_views.front().camera.time = 1;
  EXPECT_EQ(run(asked), SessionEnd::finished);
}

TEST_F(Session, ARunOf3DGaussiansIsResumedOnASceneThatMoves) {
  TestHooks hooks;
  hooks.watcher.on_step = [](int step, Trainer& trainer) {
    if (step == 5) trainer.stop();
  };
  moving_request("unused");
  TrainRequest asked = request("out");
  ASSERT_EQ(TrainSession(asked, hooks).run(), SessionEnd::stopped);
  asked.resume = "auto";
  EXPECT_EQ(run(asked), SessionEnd::finished);
}

TEST_F(Session, AModelThatCannotBeStartedFromLeavesNoFolder) {
  EXPECT_THROW(run(request("out", path("absent.ply").string())), Error);
  EXPECT_FALSE(fs::exists(path("out")));
}

}  // namespace
}  // namespace gs
