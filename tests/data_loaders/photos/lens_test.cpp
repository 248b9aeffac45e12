// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/lenses/lens.h"

#include <gmock/gmock.h>

#include <random>

#include "gs_core/error.h"
#include "tests/data_loaders/photos/lens_cases.h"
#include "tests/support/error_of.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

Vec2d pixel(const LensCamera& camera, const Vec2d& landed) {
  const PinholeCamera<double>& photo = camera.pinhole;
  return {photo.fx * landed.x + photo.cx, photo.fy * landed.y + photo.cy};
}

Vec2d landed_at(const LensCamera& camera, const Vec2d& pixel) {
  const PinholeCamera<double>& photo = camera.pinhole;
  return {(pixel.x - photo.cx) / photo.fx, (pixel.y - photo.cy) / photo.fy};
}

/// The distance of two normalized points in pixels of the photo.
double pixels_between(const LensCamera& camera, const Vec2d& a, const Vec2d& b) {
  return std::hypot(camera.pinhole.fx * (a.x - b.x), camera.pinhole.fy * (a.y - b.y));
}

/// Points spread evenly over the rectangle from (-1, -1) to (1, 1).
class RandomPoints {
 public:
  Vec2d next() { return {number(), number()}; }

 private:
  double number() { return 2 * (double(engine_()) / double(std::mt19937::max())) - 1; }
  std::mt19937 engine_{7};
};

LensCamera camera_of(CameraModel model, std::vector<double> params) {
  return lens_camera({1, model, 320, 240, std::move(params)}, "a.jpg");
}

/// Expects both cameras to send rays in front of them to the same pixels.
void expect_same(const LensCamera& a, const LensCamera& b) {
  RandomPoints random;
  for (int i = 0; i < 200; ++i) {
    const Vec2d u = random.next();
    const Vec2d pixel_a = pixel(a, distorted(a, u)), pixel_b = pixel(b, distorted(b, u));
    EXPECT_NEAR(pixel_a.x, pixel_b.x, 1e-9) << camera_model_info(a.model).name;
    EXPECT_NEAR(pixel_a.y, pixel_b.y, 1e-9) << camera_model_info(a.model).name;
  }
}

TEST(Lens, EveryModelButThePanoramaHasCases) {
  bool has_case[kCameraModelCount] = {};
  for (const LensCase& lens : lens_cases()) has_case[int(lens.camera.model)] = true;
  for (int id = 0; id < kCameraModelCount; ++id) {
    const CameraModel model{id};
    EXPECT_EQ(has_case[id], model != CameraModel::simple_pinhole && model != CameraModel::pinhole &&
                                model != CameraModel::equirectangular)
        << camera_model_info(model).name;
  }
}

TEST(Lens, LandsWhereAnIndependentProjectionSays) {
  for (const LensCase& lens : lens_cases()) {
    const LensCamera camera = lens_camera(lens.camera, "a.jpg");
    for (double y = -0.4; y <= 0.4; y += 0.1)
      for (double x = -0.5; x <= 0.5; x += 0.1) {
        const Vec2d landed = pixel(camera, distorted(camera, {x, y}));
        const Vec2d expected = projected(lens.camera, 3 * x, 3 * y, 3);
        EXPECT_NEAR(landed.x, expected.x, 1e-9) << lens.label;
        EXPECT_NEAR(landed.y, expected.y, 1e-9) << lens.label;
      }
  }
}

TEST(Lens, LandsWhereTheFormulasOfColmapSay) {
  // The ray (0.3, -0.2, 1), evaluated in Python from the formulas of COLMAP's models.h.
  struct Known {
    CameraModel model;
    std::vector<double> params;
    Vec2d pixel;
  };
  using enum CameraModel;
  const Known known[] = {
      {simple_pinhole, {1000, 640, 480}, {940, 280}},
      {pinhole, {1000, 1010, 640, 480}, {940, 278}},
      {simple_radial, {1000, 640, 480, -0.1}, {936.1, 282.6}},
      {radial, {1000, 640, 480, -0.1, 0.02}, {936.2014, 282.5324}},
      {opencv, {1000, 1010, 640, 480, -0.1, 0.02, 0.003, -0.002}, {935.2214, 281.436424}},
      {full_opencv,
       {1000, 1010, 640, 480, -0.1, 0.02, 0.003, -0.002, 0.005, 0.04, -0.03, 0.01},
       {933.8346532543, 282.3701668087}},
      {simple_radial_fisheye, {1000, 640, 480, 0.05}, {929.6524003937, 286.8983997375}},
      {radial_fisheye, {1000, 640, 480, 0.05, -0.02}, {929.5698242528, 286.9534504982}},
      {opencv_fisheye,
       {1000, 1010, 640, 480, 0.05, -0.02, 0.01, -0.004},
       {929.5745316130, 285.0198153806}},
      {simple_fisheye, {1000, 640, 480}, {927.9284507011, 288.0476995326}},
      {fisheye, {1000, 1010, 640, 480}, {927.9284507011, 286.1281765279}},
      {thin_prism_fisheye,
       {1000, 1010, 640, 480, 0.05, -0.02, 0.003, -0.002, 0.01, -0.004, 0.004, -0.005},
       {929.1508062280, 285.2244931644}},
      {rad_tan_thin_prism_fisheye,
       {1000, 1010, 640, 480, 0.4, -0.5, 0.2, 0.05, -0.06, 0.01, 0.001, -0.0005, 0.0008, -0.0002,
        -0.0009, 0.0003},
       {940.2269353757, 277.8238149884}},
      {CameraModel::fov, {1000, 1010, 640, 480, 0.9}, {949.8847543081, 271.3442654326}},
      {simple_division, {1000, 640, 480, -0.2}, {932.5810168756, 284.9459887496}},
      {division, {1000, 1010, 640, 480, -0.2}, {932.5810168756, 282.9954486371}},
      {eucm, {1000, 1010, 640, 480, 0.6, 1.1}, {928.0551954709, 286.0428350496}},
  };
  for (const Known& row : known) {
    const LensCamera camera = lens_camera({1, row.model, 1280, 960, row.params}, "a.jpg");
    const Vec2d landed = pixel(camera, distorted(camera, {0.3, -0.2}));
    EXPECT_NEAR(landed.x, row.pixel.x, 1e-8) << camera_model_info(row.model).name;
    EXPECT_NEAR(landed.y, row.pixel.y, 1e-8) << camera_model_info(row.model).name;
  }
}

TEST(Lens, EveryPixelOfThePhotoComesBackToItself) {
  for (const LensCase& lens : lens_cases()) {
    const LensCamera camera = lens_camera(lens.camera, "a.jpg");
    const PinholeCamera<double>& photo = camera.pinhole;
    RandomPoints random;
    for (int i = 0; i < 2000; ++i) {
      const Vec2d u = random.next();
      const Vec2d landed =
          landed_at(camera, {photo.width * (0.5 + 0.5 * u.x), photo.height * (0.5 + 0.5 * u.y)});
      const std::optional<Vec2d> ideal = undistorted(camera, landed);
      ASSERT_TRUE(ideal) << lens.label << " at " << landed.x << ", " << landed.y;
      ASSERT_TRUE(is_unfolded(camera, *ideal)) << lens.label;
      ASSERT_LT(pixels_between(camera, distorted(camera, *ideal), landed), 0.01) << lens.label;
    }
  }
}

TEST(Lens, EveryRayIntoThePhotoComesBackToItself) {
  for (const LensCase& lens : lens_cases()) {
    const LensCamera camera = lens_camera(lens.camera, "a.jpg");
    RandomPoints random;
    for (int found = 0, tried = 0; found < 2000; ++tried) {
      ASSERT_LT(tried, 20000) << lens.label;
      const Vec2d ideal = random.next();
      const Vec2d landed = distorted(camera, ideal), at = pixel(camera, landed);
      if (!(at.x > 0 && at.x < 320 && at.y > 0 && at.y < 240)) continue;
      ++found;
      const std::optional<Vec2d> back = undistorted(camera, landed);
      ASSERT_TRUE(back) << lens.label << " at " << ideal.x << ", " << ideal.y;
      ASSERT_LT(pixels_between(camera, *back, ideal), 0.01) << lens.label;
    }
  }
}

TEST(Lens, WideRaysComeBackToThemselves) {
  // Up to 88 degrees from the axis. Only lenses that are meant to see that far.
  const LensCamera cameras[] = {
      camera_of(CameraModel::fisheye, {100, 100, 160, 120}),
      camera_of(CameraModel::opencv_fisheye, {100, 100, 160, 120, -0.02, 0.005, -0.002, 0.0005}),
      camera_of(CameraModel::fov, {100, 100, 160, 120, 0.93}),
      camera_of(CameraModel::eucm, {100, 100, 160, 120, 0.6, 1.1}),
      camera_of(CameraModel::division, {100, 100, 160, 120, -0.2}),
  };
  for (const LensCamera& camera : cameras)
    for (int degrees = 2; degrees <= 88; degrees += 2) {
      const double r = std::tan(degrees * 0.017453292519943295);
      const Vec2d ideal(0.6 * r, -0.8 * r);
      const std::optional<Vec2d> back = undistorted(camera, distorted(camera, ideal));
      ASSERT_TRUE(back) << camera_model_info(camera.model).name << " at " << degrees;
      EXPECT_NEAR(back->x, ideal.x, 1e-6 * r) << camera_model_info(camera.model).name;
      EXPECT_NEAR(back->y, ideal.y, 1e-6 * r) << camera_model_info(camera.model).name;
    }
}

TEST(Lens, NothingLiesBeyondTheFoldOfAPolynomial) {
  // r (1 - 0.3 r^2) is largest, 0.70, at r = 1.05.
  const LensCamera camera = camera_of(CameraModel::simple_radial, {50, 50, 50, -0.3});
  EXPECT_TRUE(undistorted(camera, {0.6, 0.0}));
  EXPECT_FALSE(undistorted(camera, {0.8, 0.0}));
  EXPECT_FALSE(is_unfolded(camera, {1.2, 0.0}));
}

TEST(Lens, NothingLiesBehindTheCameraOrBeyondAClosedForm) {
  // A right angle is at pi / 2 of a fisheye, pi / (2 omega) of FOV, 1 / sqrt(-k) of a division, and
  // 1 / (alpha sqrt(beta)) of EUCM.
  EXPECT_TRUE(undistorted(camera_of(CameraModel::fisheye, {9, 9, 5, 5}), {0.0, 1.57}));
  EXPECT_FALSE(undistorted(camera_of(CameraModel::fisheye, {9, 9, 5, 5}), {0.0, 1.58}));
  EXPECT_TRUE(undistorted(camera_of(CameraModel::fov, {9, 9, 5, 5, 1}), {0.0, 1.57}));
  EXPECT_FALSE(undistorted(camera_of(CameraModel::fov, {9, 9, 5, 5, 1}), {0.0, 1.58}));
  EXPECT_TRUE(undistorted(camera_of(CameraModel::division, {9, 9, 5, 5, -0.25}), {1.99, 0.0}));
  EXPECT_FALSE(undistorted(camera_of(CameraModel::division, {9, 9, 5, 5, -0.25}), {2.01, 0.0}));
  EXPECT_TRUE(undistorted(camera_of(CameraModel::eucm, {9, 9, 5, 5, 0.5, 1}), {1.99, 0.0}));
  EXPECT_FALSE(undistorted(camera_of(CameraModel::eucm, {9, 9, 5, 5, 0.5, 1}), {2.01, 0.0}));
  // A division with k > 0 turns back at 1 / sqrt(k), the image of the ray at 1 / (2 sqrt(k)).
  const LensCamera pincushion = camera_of(CameraModel::division, {9, 9, 5, 5, 0.25});
  EXPECT_TRUE(undistorted(pincushion, {1.9, 0.0}));
  EXPECT_FALSE(undistorted(pincushion, {2.1, 0.0}));
  EXPECT_TRUE(is_unfolded(pincushion, {0.99, 0.0}));
  EXPECT_FALSE(is_unfolded(pincushion, {1.01, 0.0}));
}

TEST(Lens, ZeroCoefficientsAreTheIdealModel) {
  using enum CameraModel;
  const LensCamera ideal = camera_of(pinhole, {90, 91, 47.25, 41.5});
  for (CameraModel model : {opencv, full_opencv, CameraModel::fov, division, eucm}) {
    std::vector<double> params(camera_model_info(model).param_count, 0.0);
    const double begin[] = {90, 91, 47.25, 41.5};
    std::copy(begin, begin + 4, params.begin());
    if (model == eucm) params[5] = 1.3;  // beta means nothing without alpha
    const LensCamera camera = camera_of(model, params);
    EXPECT_EQ(camera.lens, LensCamera::Lens::none) << camera_model_info(model).name;
    expect_same(camera, ideal);
  }
  for (CameraModel model : {simple_radial, radial, simple_division}) {
    std::vector<double> params(camera_model_info(model).param_count, 0.0);
    params[0] = 90, params[1] = 47.25, params[2] = 41.5;
    EXPECT_EQ(camera_of(model, params).lens, LensCamera::Lens::none)
        << camera_model_info(model).name;
  }
  const LensCamera equidistant = camera_of(fisheye, {90, 91, 47.25, 41.5});
  for (CameraModel model : {opencv_fisheye, thin_prism_fisheye, rad_tan_thin_prism_fisheye}) {
    std::vector<double> params(camera_model_info(model).param_count, 0.0);
    const double begin[] = {90, 91, 47.25, 41.5};
    std::copy(begin, begin + 4, params.begin());
    expect_same(camera_of(model, params), equidistant);
  }
}

TEST(Lens, ShortModelsEqualTheirLongForms) {
  using enum CameraModel;
  expect_same(camera_of(simple_pinhole, {90, 50, 40}), camera_of(pinhole, {90, 90, 50, 40}));
  expect_same(camera_of(simple_radial, {90, 50, 40, -0.1}),
              camera_of(radial, {90, 50, 40, -0.1, 0}));
  expect_same(camera_of(radial, {90, 50, 40, -0.1, 0.03}),
              camera_of(opencv, {90, 90, 50, 40, -0.1, 0.03, 0, 0}));
  expect_same(camera_of(opencv, {90, 91, 50, 40, -0.1, 0.03, 1e-3, 2e-3}),
              camera_of(full_opencv, {90, 91, 50, 40, -0.1, 0.03, 1e-3, 2e-3, 0, 0, 0, 0}));
  expect_same(camera_of(simple_fisheye, {90, 50, 40}), camera_of(fisheye, {90, 90, 50, 40}));
  expect_same(camera_of(simple_radial_fisheye, {90, 50, 40, 0.1}),
              camera_of(radial_fisheye, {90, 50, 40, 0.1, 0}));
  expect_same(camera_of(radial_fisheye, {90, 50, 40, 0.1, -0.02}),
              camera_of(opencv_fisheye, {90, 90, 50, 40, 0.1, -0.02, 0, 0}));
  expect_same(
      camera_of(opencv_fisheye, {90, 91, 50, 40, 0.1, -0.02, 0.01, -0.003}),
      camera_of(thin_prism_fisheye, {90, 91, 50, 40, 0.1, -0.02, 0, 0, 0.01, -0.003, 0, 0}));
  expect_same(camera_of(opencv_fisheye, {90, 91, 50, 40, 0.1, -0.02, 0.01, -0.003}),
              camera_of(rad_tan_thin_prism_fisheye,
                        {90, 91, 50, 40, 0.1, -0.02, 0.01, -0.003, 0, 0, 0, 0, 0, 0, 0, 0}));
  expect_same(camera_of(simple_division, {90, 50, 40, -0.2}),
              camera_of(division, {90, 90, 50, 40, -0.2}));
}

TEST(Lens, WrongNumberOfParametersIsABug) {
  // The readers refuse it and name the file and the line (ColmapModel tests).
  for (int id = 0; id < kCameraModelCount; ++id) {
    const int count = camera_model_info(CameraModel(id)).param_count;
    EXPECT_ANY_THROW(camera_of(CameraModel(id), std::vector<double>(count - 1, 50.0)));
    EXPECT_ANY_THROW(camera_of(CameraModel(id), std::vector<double>(count + 1, 50.0)));
  }
}

std::string error_of(const ColmapCamera& camera) {
  return gs::error_of([&] { lens_camera(camera, "sub/a.jpg"); });
}

TEST(Lens, ImpossibleCoefficientsAreRefusedByName) {
  EXPECT_THAT(error_of({42, CameraModel::pinhole, 100, 80, {0, 90, 50, 40}}),
              AllOf(HasSubstr("focal length"), HasSubstr("camera 42 (PINHOLE)"),
                    HasSubstr("sub/a.jpg"), HasSubstr("colmap image_undistorter")));
  EXPECT_THAT(error_of({1, CameraModel::fov, 100, 80, {90, 90, 50, 40, 3.2}}),
              AllOf(HasSubstr("omega"), HasSubstr("FOV")));
}

}  // namespace
}  // namespace gs
