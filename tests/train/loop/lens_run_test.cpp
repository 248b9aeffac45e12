// SPDX-License-Identifier: Apache-2.0
// Runs on photos that were taken through a lens too wide for pinhole pictures, from COLMAP's files
// to the model that they leave.
#include "data_loaders/lenses/lens.h"
#include "gs_core/math/lens/lens_projection.h"
#include "gs_render/paths/camera_spline.h"
#include "tests/support/load_scene.h"
#include "tests/support/room.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

constexpr int kSide = 48;        // pixels
constexpr double kFocal = 12.5;  // pixels per radian: 110 degrees to each side
constexpr std::size_t kPhotos = 12;

/// Gaussians all around the cameras, and points near them.
Gaussians truth_around(std::vector<ColmapPoint>& points) {
  Draws draws(3);
  Gaussians truth(70, host_memory());
  for (std::size_t i = 0; i < truth.count(); ++i) {
    Vec3f direction = draws.uniform3(-1, 1);
    direction /= std::sqrt(inner(direction, direction));
    const Vec3f place = draws.uniform(1.6f, 2.6f) * direction;
    draw_gaussian(truth, i, place, 0.2f, 0.5f, draws);
    points.push_back({i + 1, Vec3d(place + draws.uniform3(-0.1f, 0.1f)), {128, 128, 128}});
  }
  return truth;
}

/// Cameras near the origin that look in all directions of the horizon.
ColmapModel fisheye_model() {
  ColmapModel model;
  model.cameras[1] = {1, CameraModel::simple_fisheye, kSide, kSide, {kFocal, 24, 24}};
  add_ring(model, kPhotos, {0.5, 0.2, 0.5});
  return model;
}

class LensRun : public SceneTest {
 protected:
  LensRun() {
    ColmapModel model = fisheye_model();
    truth_ = truth_around(model.points);
    write(model);
  }
  /// The scene with photos of the truth in place of plain ones.
  Scene scene_of_truth() const {
    DatasetConfig dataset = this->dataset();
    for (const View& view : load_scene(dataset).train_views)
      write_png(image(view.name), picture_of_truth(view.camera));
    dataset.eval = true;
    dataset.test_every = 6;
    return load_scene(dataset);
  }
  Image8 picture_of_truth(const Camera& camera) const {
    RenderPass pass;
    make_scalar_renderer()->forward(truth_.span(), camera, {}, pass);
    return to_image8(image_of(pass));
  }
  static Config run_through_lens() {
    Config config = short_run();
    config.train.iterations = 400;
    config.density.until_step = 0;
    return config;
  }

  Gaussians truth_;
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

TEST_F(LensRun, LearnsWhatPhotosShowBesideAndBehindTheCamera) {
  const Scene scene = scene_of_truth();
  ASSERT_EQ(scene.test_views.size(), 2u);
  ASSERT_TRUE(is_wide(scene.train_views[0].camera.lens));
  EXPECT_NEAR(scene.train_views[0].camera.lens.radius, std::sqrt(2.0) * 24 / kFocal, 1e-4);
  Trainer trainer(scene, run_through_lens(), *backend_);
  const double before = psnr_of(*backend_, trainer, scene.test_views);
  trainer.run();
  EXPECT_EQ(backend_->rows().count_not_finite(trainer.model()), 0u);
  const double after = psnr_of(*backend_, trainer, scene.test_views);
  EXPECT_GT(after, before + 8);
  EXPECT_GT(after, 25);
  // Pinholes see the same scene: the lens put every Gaussian at its place.
  std::vector<View> pinholes = scene.test_views;
  for (View& view : pinholes) {
    view.camera = without_lens(view.camera);
    view.camera.fx = view.camera.fy = 24;  // 45 degrees to each side
    view.photo = picture_of_truth(view.camera);
  }
  EXPECT_GT(psnr_of(*backend_, trainer, pinholes), 22);
}

// Pinholes and fisheyes of the same places: both together are no worse than either alone.
TEST_F(LensRun, LearnsFromPinholesAndLensesInOneRun) {
  const Scene lenses = scene_of_truth();
  const auto as_pinholes = [&](std::vector<View> views) {
    for (View& view : views) {
      view.camera = without_lens(view.camera);
      view.camera.fx = view.camera.fy = 24;
      view.photo = picture_of_truth(view.camera);
    }
    return views;
  };
  Scene pinholes = lenses, both = lenses;
  pinholes.train_views = as_pinholes(lenses.train_views);
  both.train_views.insert(both.train_views.end(), pinholes.train_views.begin(),
                          pinholes.train_views.end());
  const std::vector<View> tests[] = {lenses.test_views, as_pinholes(lenses.test_views)};
  const auto psnr_after = [&](const Scene& scene) {
    Trainer trainer(scene, run_through_lens(), *backend_);
    trainer.run();
    return std::array{psnr_of(*backend_, trainer, tests[0]), psnr_of(*backend_, trainer, tests[1])};
  };
  const auto of_both = psnr_after(both);
  const Scene* const kinds[] = {&lenses, &pinholes};
  for (const Scene* const scene : kinds) {
    const auto alone = psnr_after(*scene);
    for (int kind = 0; kind < 2; ++kind) EXPECT_GT(of_both[kind], alone[kind] - 0.5) << kind;
  }
}

/// Runs on photos of a room that are cast ray by ray: no lens is favored.
class RoomThroughLens : public SceneTest {
 protected:
  struct HeldOut {
    double own, pinholes;
  };
  /// The PSNR of held-out photos after a run on photos of such a camera, and that of pinholes at
  /// their places. `params` are without the center.
  HeldOut psnr_after(CameraModel kind, std::vector<double> params, int side, LensUse use) {
    params.insert(params.begin() + (kind == CameraModel::simple_fisheye ? 1 : 2), 2, side / 2.0);
    ColmapModel model = room_model(24, 96, 4000);
    model.cameras.at(1) = {1, kind, side, side, params};
    write(model);
    for (const ColmapImage& photo : model.images)
      write_png(image(photo.name), room_photo(photo, lens_camera(model.cameras.at(1), "")));
    DatasetConfig dataset = this->dataset();
    dataset.lens = use;
    dataset.eval = true;
    dataset.test_every = 6;
    const Scene scene = load_scene(dataset);
    Config config = short_run();
    config.train.iterations = 500;
    config.density.until_step = 0;
    Trainer trainer(scene, config, *backend_);
    trainer.run();
    std::vector<View> pinholes = scene.test_views;
    for (View& view : pinholes) {
      const auto photo = std::ranges::find(model.images, view.name, &ColmapImage::name);
      const LensCamera pinhole =
          lens_camera({1, CameraModel::pinhole, 48, 48, {34, 34, 24, 24}}, "");
      view.camera = with_pose(camera_as<float>(pinhole.pinhole), pose_of(view.camera));
      view.photo = room_photo(*photo, pinhole);
      view.mask = {};
    }
    return {psnr_of(*backend_, trainer, scene.test_views), psnr_of(*backend_, trainer, pinholes)};
  }
  /// The photo of an image through a lens, each pixel the mean of four rays.
  static Image8 room_photo(const ColmapImage& image, const LensCamera& camera) {
    const Mat3<double> R = rotation_matrix(image.cam_from_world_rotation);
    const Vec3d center = -multiply_transposed(R, image.cam_from_world_translation);
    const PinholeCamera<double>& plane = camera.pinhole;
    ImageF photo(plane.width, plane.height, 3);
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x)
        for (const double dy : {0.25, 0.75})
          for (const double dx : {0.25, 0.75}) {
            const auto u = chart_point(
                camera, {(x + dx - plane.cx) / plane.fx, (y + dy - plane.cy) / plane.fy});
            if (!u) continue;  // no ray
            const double r = std::sqrt(inner(*u, *u));
            const Vec3d ray =
                has_angle_chart(camera.lens)
                    ? Vec3d(std::sin(r) / r * u->x, std::sin(r) / r * u->y, std::cos(r))
                    : Vec3d(u->x, u->y, 1);
            const Vec3d color = room_color(center, multiply_transposed(R, ray));
            for (int c = 0; c < 3; ++c) photo.at(x, y, c) += 0.25f * float(color[c]);
          }
    return to_image8(photo);
  }
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

TEST_F(RoomThroughLens, StrongLensesLearnWhatPinholesDo) {
  const HeldOut pinhole = psnr_after(CameraModel::pinhole, {26, 26}, 48, LensUse::native);
  const HeldOut strong =  // sees as far as the pinhole
      psnr_after(CameraModel::opencv, {34, 34, -0.25, 0.05, 0, 0}, 48, LensUse::native);
  EXPECT_GT(strong.own, pinhole.own - 0.3);
  EXPECT_GT(strong.pinholes, pinhole.pinholes - 0.3);
  const HeldOut fisheye =  // 95 degrees to each side
      psnr_after(CameraModel::simple_fisheye, {24}, 80, LensUse::native);
  EXPECT_GT(fisheye.own, pinhole.own - 0.3);
  EXPECT_GT(fisheye.pinholes, pinhole.pinholes - 0.3);
}

// A lens of a phone.
TEST_F(RoomThroughLens, ALensLearnsTheSameNativelyAsUndistorted) {
  const std::vector<double> lens{24, 24, 0.08, -0.01, 1e-3, -1e-3};
  const HeldOut native = psnr_after(CameraModel::opencv, lens, 48, LensUse::native);
  const HeldOut undistorted = psnr_after(CameraModel::opencv, lens, 48, LensUse::undistort);
  EXPECT_NEAR(native.pinholes, undistorted.pinholes, 0.2);
}

TEST_F(LensRun, GoesOnWhereItWasStopped) {
  const Scene scene = scene_of_truth();
  Config config = run_through_lens();
  config.train.iterations = 60;
  EXPECT_TRUE(same_bits(resumed_after(25, scene, config, *backend_),
                        model_of_run(scene, config, *backend_)));
}

TEST_F(LensRun, RefusesAPinholeAndSaysHowToTrainInstead) {
  DatasetConfig dataset = this->dataset();
  dataset.lens = LensUse::undistort;
  EXPECT_THAT(error_of(dataset), AllOf(HasSubstr("a.png"), HasSubstr("--set dataset.lens=auto")));
}

// A lens of 55 degrees is undistorted unless it is said otherwise.
TEST_F(LensRun, TakesALensNativelyWhereItIsToldTo) {
  ColmapModel model = fisheye_model();
  model.cameras.at(1) = {
      1, CameraModel::opencv_fisheye, kSide, kSide, {25, 25, 24, 24, -0.02, 0.005, -0.002, 0.001}};
  write(model);
  DatasetConfig dataset = this->dataset();
  const Camera undistorted = load_scene(dataset).train_views[0].camera;
  EXPECT_FALSE(undistorted.has_lens());
  dataset.lens = LensUse::native;
  const View native = load_scene(dataset).train_views[0];
  EXPECT_TRUE(native.camera.has_lens());
  EXPECT_FALSE(is_wide(native.camera.lens));
  EXPECT_EQ(native.camera.width, kSide);
  EXPECT_EQ(native.photo.width, kSide);
  EXPECT_TRUE(native.mask.empty());
  dataset.resolution = 24;  // pixels wide
  EXPECT_EQ(load_scene(dataset).train_views[0].camera.lens, native.camera.lens);
}

// Its pinhole would end at 74 degrees and show less than half of the photo.
TEST_F(LensRun, TakesAFisheyeOf200DegreesNativelyByItself) {
  ColmapModel model = fisheye_model();
  model.cameras.at(1).params[0] = 24 / (100 * std::numbers::pi / 180);
  write(model);
  DatasetConfig dataset = this->dataset();
  const View view = load_scene(dataset).train_views[0];
  EXPECT_TRUE(view.camera.has_lens());
  EXPECT_TRUE(view.mask.empty());  // all of it trains
  EXPECT_THAT(log_of(dataset), HasSubstr("12 photos train through their lens"));
  dataset.lens = LensUse::undistort;
  EXPECT_FALSE(load_scene(dataset).train_views[0].camera.has_lens());
}

// A lens that folds inside of its picture: what lies beyond shows nothing that it could explain.
TEST_F(LensRun, DoesNotTrainPixelsThatNoRayReaches) {
  ColmapModel model = fisheye_model();
  model.cameras.at(1) = {1, CameraModel::opencv, kSide, kSide, {20, 20, 24, 24, -0.4, 0, 0, 0}};
  write(model);
  DatasetConfig dataset = this->dataset();
  dataset.lens = LensUse::native;
  const View view = load_scene(dataset).train_views[0];
  ASSERT_FALSE(view.mask.empty());
  EXPECT_EQ(view.mask.at(24, 24, 0), 255);
  EXPECT_EQ(view.mask.at(0, 0, 0), 0);
}

TEST_F(LensRun, RefusesDepthMapsThroughAWideLens) {
  write_png(folder() / "depth" / "a.png", Image8(kSide, kSide, 1, 50));
  EXPECT_THAT(error(), AllOf(HasSubstr("a.png"), HasSubstr("dataset.depth=none")));
}

}  // namespace
}  // namespace gs
