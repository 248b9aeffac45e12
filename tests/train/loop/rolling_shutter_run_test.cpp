// SPDX-License-Identifier: Apache-2.0
// Runs on photos whose rows were exposed one after the other by a camera that moved, from
// transforms.json to the model that they leave. The photos are cast ray by ray, each row from its own
// pose, which is computed here in another way than in gs_core.
#include "data_loaders/scene/undistort_scene.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/load_scene.h"
#include "tests/support/room.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

constexpr int kShutterSide = 48;      // pixels
constexpr double kShutterFocal = 26;  // pixels
constexpr std::size_t kShutterPhotos = 24;

/// A camera that turns evenly about its center, which goes straight.
struct MovingPose {
  Mat3<double> cam_from_world;  // at mid time
  Vec3d center;                 // then
  Vec3d turn, shift;            // from the first row to the last, in its axes

  Mat3<double> axes_at(double time) const {
    const double angle = std::sqrt(inner(turn, turn)), half = (time - 0.5) * angle / 2;
    const Vec3d axis = angle > 0 ? std::sin(half) / angle * turn : Vec3d(0.0);
    const Mat3<double> R = rotation_matrix(Quat<double>{std::cos(half), axis.x, axis.y, axis.z});
    const auto row = [&](const Vec3d& of) { return multiply_transposed(cam_from_world, of); };
    return {row(R.row0), row(R.row1), row(R.row2)};
  }
  Vec3d center_at(double time) const {
    return center + (time - 0.5) * multiply_transposed(cam_from_world, shift);
  }
  /// camera-to-world with OpenGL's axes.
  SortedJson matrix_at(double time) const {
    const Mat3<double> W = axes_at(time);
    const Vec3d c = center_at(time);
    SortedJson rows = SortedJson::array();
    for (int i = 0; i < 3; ++i) rows.push_back({W.row0[i], -W.row1[i], -W.row2[i], c[i]});
    rows.push_back({0, 0, 0, 1});
    return rows;
  }
  Image8 photo() const {
    ImageF image(kShutterSide, kShutterSide, 3);
    for (int y = 0; y < kShutterSide; ++y)
      for (const double dy : {0.25, 0.75}) {
        const double time = (y + dy) / kShutterSide;
        const Mat3<double> W = axes_at(time);
        for (int x = 0; x < kShutterSide; ++x)
          for (const double dx : {0.25, 0.75}) {
            const Vec3d ray((x + dx - kShutterSide / 2) / kShutterFocal,
                            (y + dy - kShutterSide / 2) / kShutterFocal, 1);
            const Vec3d color = room_color(center_at(time), multiply_transposed(W, ray));
            for (int c = 0; c < 3; ++c) image.at(x, y, c) += 0.25f * float(color[c]);
          }
      }
    return to_image8(image);
  }
};

class RollingShutterRun : public SceneTest {
 protected:
  RollingShutterRun() {
    Draws draws(5);
    const ColmapModel room = room_model(kShutterPhotos, 96, 4000);
    file_ = {{"fl_x", kShutterFocal},
             {"w", kShutterSide},
             {"h", kShutterSide},
             {"ply_file_path", "points.ply"}};
    for (const ColmapImage& image : room.images) {
      MovingPose& pose = poses_.emplace_back();
      pose.cam_from_world = rotation_matrix(image.cam_from_world_rotation);
      pose.center = -multiply_transposed(pose.cam_from_world, image.cam_from_world_translation);
      pose.turn = Vec3d(draws.uniform3(-0.3f, 0.3f)),
      pose.shift = Vec3d(draws.uniform3(-0.2f, 0.2f));
      names_.push_back("images/" + image.name);
      file_["frames"].push_back({{"file_path", names_.back()},
                                 {"transform_matrix_start", pose.matrix_at(0)},
                                 {"transform_matrix_end", pose.matrix_at(1)}});
      write_png(folder() / names_.back(), pose.photo());
    }
    write_file();
    std::vector<ScenePoint> points;
    for (const ColmapPoint& point : room.points)
      points.push_back({Vec3f(point.position), point.color});
    write_point_ply(folder() / "points.ply", points);
  }
  void write_file() const { write_bytes(folder() / "transforms.json", file_.dump()); }
  Scene scene(bool rolling_shutter) const {
    DatasetConfig dataset = this->dataset();
    dataset.rolling_shutter = rolling_shutter;
    dataset.eval = true;
    dataset.test_every = 6;
    return load_scene(dataset);
  }
  const MovingPose& pose_of_photo(const std::string& name) const {
    return poses_[std::size_t(std::ranges::find(names_, name) - names_.begin())];
  }
  /// The views with photos of cameras that stood still at mid time.
  std::vector<View> standing_still(std::vector<View> views) const {
    for (View& view : views) {
      view.camera = without_lens(view.camera);
      MovingPose pose = pose_of_photo(view.name);
      pose.turn = pose.shift = Vec3d(0.0);
      view.photo = pose.photo();
    }
    return views;
  }

  SortedJson file_;
  std::vector<MovingPose> poses_;
  std::vector<std::string> names_;
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

TEST_F(RollingShutterRun, LearnsWhatStandingCamerasDo) {
  Config config = short_run();
  config.train.iterations = 500;
  config.density.until_step = 0;
  struct HeldOut {
    double own, still;
  };
  const auto after_run_on = [&](const Scene& scene) {
    Trainer trainer(scene, config, *backend_);
    trainer.run();
    return HeldOut{psnr_of(*backend_, trainer, scene.test_views),
                   psnr_of(*backend_, trainer, standing_still(scene.test_views))};
  };
  const Scene with = this->scene(true), without = this->scene(false);
  ASSERT_TRUE(with.train_views[0].camera.has_rolling_shutter());
  ASSERT_FALSE(without.train_views[0].camera.has_lens());
  Scene still = without;
  still.train_views = standing_still(without.train_views);
  const HeldOut shutter = after_run_on(with), ignored = after_run_on(without),
                best = after_run_on(still);
  EXPECT_GT(shutter.own, ignored.own + 5);
  EXPECT_GT(shutter.still, ignored.still + 5);
  EXPECT_GT(shutter.still, best.still - 1.2);
}

/// The picture of a moving camera, row by row from cameras that stand still.
ImageF row_by_row(Renderer& renderer, const Gaussians& gaussians, const Camera& moving,
                  const MovingPose& pose) {
  ImageF picture(moving.width, moving.height, 3);
  for (int y = 0; y < moving.height; ++y) {
    const double time = (y + 0.5) / moving.height;
    const Mat3<double> W = pose.axes_at(time);
    Camera still = without_lens(moving);
    still.cam_from_world_rotation = {Vec3f(W.row0), Vec3f(W.row1), Vec3f(W.row2)};
    still.cam_from_world_translation = Vec3f(-multiply(W, pose.center_at(time)));
    RenderPass pass;
    renderer.forward(gaussians.span(), still, {}, pass);
    const ImageF whole = image_of(pass);
    for (int x = 0; x < moving.width; ++x)
      for (int c = 0; c < 3; ++c) picture.at(x, y, c) = whole.at(x, y, c);
  }
  return picture;
}

TEST_F(RollingShutterRun, PicturesAreThoseOfStandingCamerasRowByRow) {
  Draws draws(3);
  Gaussians room(600, host_memory());
  const ColmapModel model = room_model(1, 96, room.count());
  for (std::size_t i = 0; i < room.count(); ++i) {
    const ColmapPoint& point = model.points[i];
    draw_gaussian(room, i, Vec3f(point.position), 0.04f, 0.1f, draws);
  }
  const std::unique_ptr<Renderer> renderer = make_scalar_renderer();
  double worst = 1e9, worst_without = 1e9;
  for (const View& view : scene(true).test_views) {
    MovingPose pose = pose_of_photo(view.name);
    pose.turn *= 0.35, pose.shift *= 0.35;  // what a hand does
    const Camera moving =
        with_motion(view.camera, RigidMotion<float>{Vec3f(pose.turn), Vec3f(pose.shift)});
    const ImageF expected = row_by_row(*renderer, room, moving, pose);
    const auto psnr_through = [&](const Camera& camera) {
      RenderPass pass;
      renderer->forward(room.span(), camera, {}, pass);
      return psnr(image_of(pass), to_image8(expected));
    };
    worst = std::min(worst, psnr_through(moving));
    worst_without = std::min(worst_without, psnr_through(without_lens(view.camera)));
  }
  EXPECT_GT(worst, 40);
  EXPECT_LT(worst_without, 28);
}

TEST_F(RollingShutterRun, PhotosWithALensTrainThroughIt) {
  file_["k1"] = 0.05;
  write_file();
  DatasetConfig dataset = this->dataset();
  EXPECT_THAT(log_of(dataset), HasSubstr("24 photos were taken row by row"));
  const Camera moving = load_scene(dataset).train_views[0].camera;
  EXPECT_TRUE(moving.has_rolling_shutter());
  EXPECT_EQ(moving.lens.k[0], 0.05f);
  dataset.lens = LensUse::undistort;
  EXPECT_THAT(error_of(dataset), AllOf(HasSubstr("images/a.png"), HasSubstr("dataset.lens=auto"),
                                       HasSubstr("dataset.rolling_shutter=false")));
  dataset.rolling_shutter = false;
  EXPECT_FALSE(load_scene(dataset).train_views[0].camera.has_lens());
}

TEST_F(RollingShutterRun, WhatNeedsOnePoseForAPhotoIsRefused) {
  const auto is_of_motion = AllOf(HasSubstr("images/"), HasSubstr("dataset.rolling_shutter=false"));
  EXPECT_THAT(error_of([&] { undistort_scene(dataset(), folder() / "out", 0); }), is_of_motion);
  write_png(folder() / "depth/images/a.png", Image8(kShutterSide, kShutterSide, 1, 50));
  EXPECT_THAT(error(), AllOf(is_of_motion, HasSubstr("dataset.depth=none")));
  std::filesystem::remove_all(folder() / "depth");
  for (const std::string& name : names_) write_png(folder() / name, Image8(96, 48, 3, 100));
  file_["camera_model"] = "EQUIRECTANGULAR", file_["w"] = 96;
  write_file();
  EXPECT_THAT(error(), is_of_motion);
}

}  // namespace
}  // namespace gs
