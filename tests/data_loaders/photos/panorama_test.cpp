// SPDX-License-Identifier: Apache-2.0
// Panoramas of 360 degrees, from their file to the two views that they train as.
#include <set>

#include "data_loaders/lenses/hemispheres.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/refine/refine_cameras.h"
#include "data_loaders/refine/refine_exposure.h"
#include "data_loaders/scene/split_panoramas.h"
#include "gs_core/math/lens/lens_projection.h"
#include "gs_core/system/text/json.h"
#include "gs_render/panorama.h"
#include "tests/support/load_scene.h"
#include "tests/support/room.h"
#include "tests/support/test.h"

namespace gs {
namespace {

constexpr int kWidth = 256;  // pixels, of panoramas

/// Smooth colors of all directions.
Vec3d smooth_color(const Vec3d& ray) {
  return {0.5 + 0.4 * ray.x, 0.5 + 0.3 * std::sin(3 * ray.y), 0.5 + 0.4 * ray.z * ray.x};
}

LensCamera hemisphere_camera(int width) {
  return lens_camera(
      {1, CameraModel::equirectangular, width, width / 2, {double(width), double(width / 2)}},
      "a.jpg");
}

/// The direction that a pixel of a half shows, in the frame of the panorama.
Vec3d ray_of(const LensCamera& camera, double x, double y, bool is_back) {
  const PinholeCamera<double>& to = camera.pinhole;
  const Vec2d u((x - to.cx) / to.fx, (y - to.cy) / to.fy);
  const double theta = std::sqrt(inner(u, u)), scale = std::sin(theta) / theta;
  const double side = is_back ? -1 : 1;
  return {side * scale * u.x, scale * u.y, side * std::cos(theta)};
}

// The seam lies in the half behind, the poles at the rims of both.
TEST(Panorama, HalvesShowItsDirectionsAlsoAtSeamAndPoles) {
  const Image8 panorama = panorama_of(kWidth, smooth_color);
  const LensCamera camera = hemisphere_camera(kWidth);
  EXPECT_NEAR(camera.pinhole.width, 1.06 * kWidth / 2, 1);
  for (const bool is_back : {false, true}) {
    const Image8 half = hemisphere_of(evened_panorama(panorama), camera, is_back, "a.jpg");
    int largest = 0;
    for (int y = 0; y < half.height; ++y)
      for (int x = 0; x < half.width; ++x) {
        const Vec3d expected = smooth_color(ray_of(camera, x + 0.5, y + 0.5, is_back));
        for (int c = 0; c < 3; ++c)
          largest = std::max(largest, std::abs(half.at(x, y, c) - int(255 * expected[c] + 0.5)));
      }
    EXPECT_LE(largest, 2) << is_back;  // of 255: two roundings
  }
}

// Noise of one value per direction has ever fewer directions towards the poles.
TEST(Panorama, RowsNearThePolesAreAveraged) {
  Image8 panorama(kWidth, kWidth / 2, 1);
  for (int y = 0; y < panorama.height; ++y)
    for (int x = 0; x < kWidth; ++x) panorama.at(x, y, 0) = x % 2 ? 255 : 0;
  const Image8 even = evened_panorama(panorama);
  EXPECT_EQ(even.at(7, kWidth / 4, 0), 255);  // the equator stays
  EXPECT_NEAR(even.at(7, 1, 0), 128, 6);
  EXPECT_NEAR(even.at(0, 1, 0), 128, 6);  // around the seam
}

TEST(Panorama, APixelIsInTheHalfThatLooksItsWay) {
  const ColmapCamera panorama{1, CameraModel::equirectangular, 400, 200, {400, 200}};
  const LensCamera camera = lens_camera(panorama, "a.jpg");
  for (const double x : {1.0, 120.0, 199.0, 280.0, 399.0})
    for (const double y : {1.0, 60.0, 100.0, 199.0}) {
      const HemispherePixel at = hemisphere_pixel(panorama, {x, y});
      const Vec3d ray = panorama_ray(x, y, 400, 200);
      EXPECT_EQ(at.is_back, ray.z < 0);
      const Vec3d seen = ray_of(camera, at.pixel.x, at.pixel.y, at.is_back);
      EXPECT_NEAR(inner(seen - ray, seen - ray), 0, 1e-20) << x << " " << y;
    }
}

class PanoramaScene : public SceneTest {
 protected:
  PanoramaScene() {
    write(model_);
    for (const ColmapImage& image : model_.images)
      write_png(this->image(image.name), room_photo(image, kWidth));
  }
  ColmapModel model_ = room_model(8, kWidth);
};

TEST_F(PanoramaScene, TrainsAsTwoHemispheresThatAreNeverSplit) {
  DatasetConfig dataset = this->dataset();
  EXPECT_THAT(log_of(dataset), HasSubstr("8 panoramas train as two fisheye views each"));
  dataset.eval = true;
  dataset.test_every = 4;
  const Scene scene = load_scene(dataset);
  EXPECT_THAT(names_of(scene.test_views),
              testing::ElementsAre("a.back.png", "a.front.png", "e.back.png", "e.front.png"));
  EXPECT_EQ(scene.train_views.size(), 12u);
  for (std::size_t i = 0; i < scene.train_views.size(); i += 2) {
    const View &back = scene.train_views[i], &front = scene.train_views[i + 1];
    EXPECT_EQ(back.rig_frame, front.rig_frame);
    EXPECT_TRUE(is_wide(front.camera.lens));
    EXPECT_FLOAT_EQ(front.camera.lens.radius, float(kHemisphereReach));
    const Vec3f apart = back.camera.position() - front.camera.position();
    EXPECT_LT(inner(apart, apart), 1e-12f);
    EXPECT_LT(
        inner(back.camera.cam_from_world_rotation.row2, front.camera.cam_from_world_rotation.row2),
        -0.999999f);
  }
}

TEST_F(PanoramaScene, OnlyPixelsWithinTheRadiusTrain) {
  const View view = load().train_views[0];
  const Camera& camera = view.camera;
  ASSERT_EQ(view.mask.width, camera.width);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const double theta =
          std::hypot(x + 0.5 - double(camera.cx), y + 0.5 - double(camera.cy)) / camera.fx;
      if (std::abs(theta - kHemisphereReach) < 1e-4) continue;
      EXPECT_EQ(view.mask.at(x, y, 0), theta < kHemisphereReach ? 255 : 0) << x << " " << y;
    }
}

TEST_F(PanoramaScene, ViewsShowWhatThePinholesOfTheSceneWould) {
  const std::vector<View> views = load().train_views;
  for (const View& view : views) {
    const PinholeCamera<double> camera = camera_as<double>(view.camera);
    double sum = 0;
    int count = 0;
    for (int y = 0; y < view.photo.height; ++y)
      for (int x = 0; x < view.photo.width; ++x) {
        if (view.mask.at(x, y, 0) == 0) continue;
        const Vec2d u((x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy);
        const double theta = std::sqrt(inner(u, u)), scale = std::sin(theta) / theta;
        const Vec3d ray = multiply_transposed(camera.cam_from_world_rotation,
                                              Vec3d(scale * u.x, scale * u.y, std::cos(theta)));
        const Vec3d color = room_color(camera.position(), ray);
        for (int c = 0; c < 3; ++c, ++count) {
          const double error = view.photo.at(x, y, c) / 255.0 - color[c];
          sum += error * error;
        }
      }
    EXPECT_LT(std::sqrt(sum / count), 0.02) << view.name;  // the walls' edges are sharp
  }
}

TEST_F(PanoramaScene, SmallerFilesAndResolutionsKeepTheRadius) {
  for (const ColmapImage& image : model_.images)
    write_png(this->image(image.name), room_photo(image, kWidth / 2));
  DatasetConfig dataset = this->dataset();
  dataset.resolution = 2;
  const View view = load_scene(dataset).train_views[0];
  EXPECT_NEAR(view.camera.width, 1.06 * kWidth / 8, 1);
  EXPECT_EQ(view.photo.width, view.camera.width);
  EXPECT_FLOAT_EQ(view.camera.lens.radius, float(kHemisphereReach));
}

// In evaluations; the whole is as sharp as the halves.
TEST_F(PanoramaScene, FrontHalvesGiveTheWholePanorama) {
  Image8 mask(kWidth, kWidth / 2, 1, 255);
  for (int x = 0; x < kWidth; ++x) mask.at(x, kWidth / 2 - 1, 0) = 0;
  write_png(folder() / "masks" / "a.png", mask);
  DatasetConfig dataset = this->dataset();
  for (const int resolution : {1, 2}) {
    dataset.resolution = resolution;
    const std::vector<View> views = load_scene(dataset).train_views;
    EXPECT_FALSE(views[0].panorama);
    const View whole = views[1].panorama();
    EXPECT_EQ(whole.photo.width, kWidth / resolution);
    EXPECT_EQ(whole.photo.height, kWidth / 2 / resolution);
    EXPECT_EQ(whole.mask.at(3, whole.photo.height - 2, 0), 255);
    EXPECT_EQ(whole.mask.at(3, whole.photo.height - 1, 0), resolution == 1 ? 0 : 128);
    if (resolution == 1) EXPECT_EQ(whole.photo.pixels, room_photo(model_.images[0], kWidth).pixels);
  }
}

// Photos of a room, cut into halves and put together again: there is no step at the seam and at the
// poles that the truth does not have.
TEST(Panorama, HalvesPutTogetherAreContinuousAtSeamAndPoles) {
  const ColmapImage image = room_model(2, kWidth).images[1];
  Camera camera;
  camera.width = kWidth, camera.height = kWidth / 2;
  const std::array<Camera, 2> cameras = panorama_halves(camera);
  const Image8 truth = room_photo(image, kWidth), fine = room_photo(image, 3 * kWidth / 2);
  const LensCamera half = hemisphere_camera(3 * kWidth / 2);
  std::array<ImageF, 2> halves;
  for (const bool is_back : {false, true}) {
    const Image8 cut = hemisphere_of(evened_panorama(fine), half, is_back, "a.jpg");
    ASSERT_EQ(cut.width, cameras[is_back].width);
    halves[is_back] = ImageF(cut.width, cut.height, 3);
    for (std::size_t i = 0; i < cut.pixels.size(); ++i)
      halves[is_back].pixels[i] = float(cut.pixels[i]) / 255;
  }
  const Image8 joined = to_image8(joined_panorama(camera, halves, true));
  const auto step = [](const Image8& picture, int x, int y, int to_x, int to_y) {
    int largest = 0;
    for (int c = 0; c < 3; ++c)
      largest =
          std::max(largest, std::abs(int(picture.at(to_x, to_y, c)) - int(picture.at(x, y, c))));
    return largest;
  };
  const auto largest_steps = [&](const Image8& picture) {
    std::array<int, 3> largest{};  // at the seam, where the halves meet, over the poles
    for (int y = 0; y < picture.height; ++y) {
      largest[0] = std::max(largest[0], step(picture, kWidth - 1, y, 0, y));
      largest[1] = std::max(largest[1], step(picture, kWidth / 4 - 1, y, kWidth / 4, y));
    }
    for (int x = 0; x < kWidth; ++x)
      for (const int y : {0, kWidth / 2 - 1})
        largest[2] = std::max(largest[2], step(picture, x, y, (x + kWidth / 2) % kWidth, y));
    return largest;
  };
  const std::array<int, 3> of_truth = largest_steps(truth), of_joined = largest_steps(joined);
  for (int place = 0; place < 3; ++place) EXPECT_LE(of_joined[place], of_truth[place] + 2) << place;
  double sum = 0;
  for (std::size_t i = 0; i < truth.pixels.size(); ++i) {
    const double error = (double(joined.pixels[i]) - double(truth.pixels[i])) / 255;
    sum += error * error;
  }
  EXPECT_LT(std::sqrt(sum / double(truth.pixels.size())), 0.02);
}

// The colors under a mask, here at the pole, never show.
TEST_F(PanoramaScene, MasksAreThoseOfThePanorama) {
  Image8 photo = room_photo(model_.images[0], kWidth), mask(kWidth, kWidth / 2, 1, 255);
  for (int y = 7 * kWidth / 16; y < kWidth / 2; ++y)  // the tripod
    for (int x = 0; x < kWidth; ++x) {
      mask.at(x, y, 0) = 0;
      for (int c = 0; c < 3; ++c) photo.at(x, y, c) = c == 0 ? 255 : 0;
    }
  write_png(image("a.png"), photo);
  write_png(folder() / "masks" / "a.png", mask);
  const std::vector<View> views = load().train_views;
  const View& front = views[1];
  ASSERT_EQ(front.name, "a.front.png");
  const int middle = front.photo.width / 2, bottom = int(front.camera.cy + 1.5f * front.camera.fy);
  EXPECT_EQ(front.mask.at(middle, bottom, 0), 0);
  EXPECT_EQ(front.mask.at(middle, middle, 0), 255);
  for (int y = 0; y < front.photo.height; ++y)
    for (int x = 0; x < front.photo.width; ++x) {
      const bool is_red = front.photo.at(x, y, 0) > 200 && front.photo.at(x, y, 1) < 20;
      EXPECT_FALSE(is_red && front.mask.at(x, y, 0) > 20) << x << " " << y;
    }
}

TEST_F(PanoramaScene, ObservationsGoToTheHalfThatSeesThem) {
  ColmapModel model = model_;
  for (ColmapImage& image : model.images) {
    const Mat3<double> R = rotation_matrix(image.cam_from_world_rotation);
    for (const ColmapPoint& point : model.points) {
      const Vec3d p = multiply(R, point.position) + image.cam_from_world_translation;
      image.observations.push_back(
          {point.id, (std::atan2(p.x, p.z) / (2 * std::numbers::pi) + 0.5) * kWidth,
           (std::atan2(p.y, std::hypot(p.x, p.z)) / std::numbers::pi + 0.5) * kWidth / 2});
    }
  }
  model.frames = {{1, 1, {1}}};  // of a rig
  const std::vector<SplitImage> origins = split_panoramas(model);
  ASSERT_EQ(model.images.size(), 16u);
  EXPECT_EQ(model.frames.size(), 8u);
  std::set<std::uint32_t> ids;
  for (std::size_t i = 0; i < 16; ++i) {
    EXPECT_EQ(origins[i].image, i / 2);
    EXPECT_EQ(origins[i].is_back, i % 2 == 0);
    ids.insert(model.images[i].id);
  }
  EXPECT_EQ(ids.size(), 16u);
  EXPECT_EQ(model.images[0].observations.size() + model.images[1].observations.size(), 400u);
  if (!can_refine()) return;
  const CameraRefinement refined = refine_cameras(model);  // they fit the poses, which are exact
  EXPECT_EQ(refined.observations, 8u * 400);
  EXPECT_LT(refined.mean_error_before, 1e-6);
}

TEST_F(PanoramaScene, IsRefusedAsAPinholeAndSaysHowToTrainInstead) {
  DatasetConfig dataset = this->dataset();
  dataset.lens = LensUse::undistort;
  EXPECT_THAT(error_of(dataset), AllOf(HasSubstr("'a.back.png'"), HasSubstr("dataset.lens=auto")));
}

TEST_F(PanoramaScene, ReadsTheSameFromTransforms) {
  const Scene expected = load();
  SortedJson file{{"camera_model", "EQUIRECTANGULAR"}, {"w", kWidth}, {"h", kWidth / 2}};
  for (const ColmapImage& image : model_.images) {
    const Mat3<double> R = rotation_matrix(image.cam_from_world_rotation);
    const Vec3d at = -multiply_transposed(R, image.cam_from_world_translation);
    file["frames"].push_back({{"file_path", "images/" + image.name},
                              {"transform_matrix",
                               {{R.row0.x, -R.row1.x, -R.row2.x, at.x},
                                {R.row0.y, -R.row1.y, -R.row2.y, at.y},
                                {R.row0.z, -R.row1.z, -R.row2.z, at.z},
                                {0, 0, 0, 1}}}});
  }
  std::filesystem::remove_all(folder() / "sparse");
  write_bytes(folder() / "transforms.json", file.dump());
  const Scene scene = load();
  ASSERT_EQ(scene.train_views.size(), expected.train_views.size());
  for (std::size_t i = 0; i < scene.train_views.size(); ++i) {
    EXPECT_EQ(scene.train_views[i].name, "images/" + expected.train_views[i].name);
    EXPECT_EQ(scene.train_views[i].photo.pixels, expected.train_views[i].photo.pixels);
    const Vec3f apart =
        scene.train_views[i].camera.position() - expected.train_views[i].camera.position();
    EXPECT_LT(inner(apart, apart), 1e-10f);
  }
}

}  // namespace
}  // namespace gs
