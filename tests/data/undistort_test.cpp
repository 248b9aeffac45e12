// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/undistort.h"

#include <gmock/gmock.h>

#include <cmath>

#include "gs_core/error.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

struct Lens {
  const char* label;
  ColmapCamera camera;
};

/// Typical and strong lenses of every supported model; principal points off the centre.
std::vector<Lens> lenses() {
  return {
      {"simple_radial", {1, CameraModel::simple_radial, 320, 240, {260, 163, 117, -0.09}}},
      {"radial", {1, CameraModel::radial, 320, 240, {260, 163, 117, -0.12, 0.03}}},
      {"pincushion", {1, CameraModel::radial, 320, 240, {260, 163, 117, 0.1, 0.02}}},
      {"opencv",
       {1, CameraModel::opencv, 320, 240, {262, 258, 151, 127, -0.11, 0.02, 2e-3, -3e-3}}},
      {"full_opencv",
       {1,
        CameraModel::full_opencv,
        320,
        240,
        {262, 258, 151, 127, 0.2, 0.05, 1e-3, -2e-3, 0.01, 0.3, 0.06, 0.005}}},
      {"opencv_fisheye",
       {1,
        CameraModel::opencv_fisheye,
        320,
        240,
        {180, 178, 158, 122, -0.02, 0.005, -0.002, 0.001}}},
      {"simple_radial_fisheye",
       {1, CameraModel::simple_radial_fisheye, 320, 240, {180, 158, 122, 0.03}}},
      {"radial_fisheye", {1, CameraModel::radial_fisheye, 320, 240, {180, 158, 122, 0.03, -0.01}}},
      {"simple_fisheye", {1, CameraModel::simple_fisheye, 320, 240, {180, 158, 122}}},
      {"fisheye", {1, CameraModel::fisheye, 320, 240, {180, 181, 158, 122}}},
  };
}

/// Where a point in camera space lands in the photo, in pixels with centres at + 0.5: written from
/// COLMAP's description of its parameters, in spherical coordinates for fisheyes, and sharing no
/// code with lens.cpp.
Vec2d projected(const ColmapCamera& camera, double X, double Y, double Z) {
  const std::vector<double>& p = camera.params;
  const double x = X / Z, y = Y / Z, r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
  const double angle = std::atan2(std::hypot(X, Y), Z), turn = std::atan2(Y, X);
  const auto fisheye = [&](double fx, double fy, double cx, double cy, double k1, double k2,
                           double k3, double k4) {
    const double bent = angle + k1 * std::pow(angle, 3) + k2 * std::pow(angle, 5) +
                        k3 * std::pow(angle, 7) + k4 * std::pow(angle, 9);
    return Vec2d(fx * bent * std::cos(turn) + cx, fy * bent * std::sin(turn) + cy);
  };
  const auto tangential_x = [&](double p1, double p2) {
    return 2 * p1 * x * y + p2 * (3 * x * x + y * y);
  };
  const auto tangential_y = [&](double p1, double p2) {
    return 2 * p2 * x * y + p1 * (x * x + 3 * y * y);
  };
  switch (camera.model) {
    case CameraModel::simple_radial: {
      const double s = 1 + p[3] * r2;
      return {p[0] * x * s + p[1], p[0] * y * s + p[2]};
    }
    case CameraModel::radial: {
      const double s = 1 + p[3] * r2 + p[4] * r4;
      return {p[0] * x * s + p[1], p[0] * y * s + p[2]};
    }
    case CameraModel::opencv: {
      const double s = 1 + p[4] * r2 + p[5] * r4;
      return {p[0] * (x * s + tangential_x(p[6], p[7])) + p[2],
              p[1] * (y * s + tangential_y(p[6], p[7])) + p[3]};
    }
    case CameraModel::full_opencv: {
      const double s =
          (1 + p[4] * r2 + p[5] * r4 + p[8] * r6) / (1 + p[9] * r2 + p[10] * r4 + p[11] * r6);
      return {p[0] * (x * s + tangential_x(p[6], p[7])) + p[2],
              p[1] * (y * s + tangential_y(p[6], p[7])) + p[3]};
    }
    case CameraModel::opencv_fisheye:
      return fisheye(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]);
    case CameraModel::simple_radial_fisheye: return fisheye(p[0], p[0], p[1], p[2], p[3], 0, 0, 0);
    case CameraModel::radial_fisheye: return fisheye(p[0], p[0], p[1], p[2], p[3], p[4], 0, 0);
    case CameraModel::simple_fisheye: return fisheye(p[0], p[0], p[1], p[2], 0, 0, 0, 0);
    case CameraModel::fisheye: return fisheye(p[0], p[1], p[2], p[3], 0, 0, 0, 0);
    default: ADD_FAILURE(); return {};
  }
}

/// A smooth scene: its colour in the direction (x, y, 1).
double scene_colour(double x, double y, int channel) {
  return 128 + 60 * std::sin(9 * x + channel) + 50 * std::cos(7 * y - 3 * x + 2 * channel);
}

std::uint8_t rounded(double value) { return std::uint8_t(std::lround(value)); }

std::string error_of(const ColmapCamera& camera) {
  try {
    undistorted_pinhole(lens_camera(camera, "sub/a.jpg"), "sub/a.jpg");
  } catch (const Error& error) {
    return error.what();
  }
  ADD_FAILURE() << "no Error";
  return "";
}

TEST(Lens, LandsWhereAnIndependentProjectionSays) {
  for (const Lens& lens : lenses()) {
    const LensCamera camera = lens_camera(lens.camera, "a.jpg");
    for (double y = -0.4; y <= 0.4; y += 0.1)
      for (double x = -0.5; x <= 0.5; x += 0.1) {
        const Vec2d landed = distorted(camera, {x, y});
        const Vec2d expected = projected(lens.camera, 3 * x, 3 * y, 3);
        EXPECT_NEAR(camera.pinhole.fx * landed.x + camera.pinhole.cx, expected.x, 1e-9)
            << lens.label;
        EXPECT_NEAR(camera.pinhole.fy * landed.y + camera.pinhole.cy, expected.y, 1e-9)
            << lens.label;
      }
  }
}

TEST(Lens, UndistortedIsTheInverse) {
  for (const Lens& lens : lenses()) {
    const LensCamera camera = lens_camera(lens.camera, "a.jpg");
    for (double y = -0.5; y <= 0.5; y += 0.125)
      for (double x = -0.6; x <= 0.6; x += 0.1) {
        const auto back = undistorted(camera, distorted(camera, {x, y}));
        ASSERT_TRUE(back) << lens.label;
        EXPECT_NEAR(back->x, x, 1e-8) << lens.label;
        EXPECT_NEAR(back->y, y, 1e-8) << lens.label;
      }
  }
}

TEST(Lens, NothingLiesBeyondTheFoldOfAPolynomial) {
  // r (1 - 0.3 r^2) is largest, 0.70, at r = 1.05.
  const LensCamera camera =
      lens_camera({1, CameraModel::simple_radial, 100, 100, {50, 50, 50, -0.3}}, "a.jpg");
  EXPECT_TRUE(undistorted(camera, {0.6, 0.0}));
  EXPECT_FALSE(undistorted(camera, {0.8, 0.0}));
  EXPECT_FALSE(is_unfolded(camera, {1.2, 0.0}));
}

TEST(Undistort, PinholesStayAsTheyAre) {
  const ColmapCamera cameras[] = {
      {1, CameraModel::simple_pinhole, 100, 80, {90, 47.25, 41.5}},
      {1, CameraModel::pinhole, 100, 80, {90, 91, 47.25, 41.5}},
      {1, CameraModel::opencv, 100, 80, {90, 91, 47.25, 41.5, 0, 0, 0, 0}},
  };
  for (const ColmapCamera& colmap : cameras) {
    const LensCamera camera = lens_camera(colmap, "a.jpg");
    EXPECT_EQ(camera.lens, LensCamera::Lens::none);
    const PinholeCamera<double> pinhole = undistorted_pinhole(camera, "a.jpg");
    EXPECT_EQ(pinhole.width, 100);
    EXPECT_EQ(pinhole.height, 80);
    EXPECT_EQ(pinhole.fx, 90);
    EXPECT_EQ(pinhole.cx, 47.25);
    EXPECT_EQ(pinhole.cy, 41.5);
  }
}

TEST(Undistort, EverySupportedLensKeepsItsFocalLengthsAndRelativePrincipalPoint) {
  if (!can_undistort()) GTEST_SKIP() << "built without OpenCV";
  for (const Lens& lens : lenses()) {
    const LensCamera camera = lens_camera(lens.camera, "a.jpg");
    const PinholeCamera<double> pinhole = undistorted_pinhole(camera, "a.jpg");
    EXPECT_EQ(pinhole.fx, camera.pinhole.fx) << lens.label;
    EXPECT_EQ(pinhole.fy, camera.pinhole.fy) << lens.label;
    EXPECT_NEAR(pinhole.cx / pinhole.width, camera.pinhole.cx / camera.pinhole.width, 1e-12)
        << lens.label;
    EXPECT_NEAR(pinhole.cy / pinhole.height, camera.pinhole.cy / camera.pinhole.height, 1e-12)
        << lens.label;
  }
}

TEST(Undistort, EveryPixelShowsThePhotoAndNoLargerPictureWould) {
  if (!can_undistort()) GTEST_SKIP() << "built without OpenCV";
  for (const Lens& lens : lenses()) {
    const PinholeCamera<double> pinhole =
        undistorted_pinhole(lens_camera(lens.camera, "a.jpg"), "a.jpg");
    double nearest = 1e9;  // of all outermost pixels to the photo's border
    for (int y = 0; y < pinhole.height; ++y)
      for (int x = 0; x < pinhole.width; ++x) {
        const Vec2d at = projected(lens.camera, (x + 0.5 - pinhole.cx) / pinhole.fx,
                                   (y + 0.5 - pinhole.cy) / pinhole.fy, 1);
        const double inside =
            std::min({at.x, lens.camera.width - at.x, at.y, lens.camera.height - at.y});
        nearest = std::min(nearest, inside);
      }
    EXPECT_GT(nearest, 0.49) << lens.label;  // the outermost pixel centres of the photo lie at 0.5
    EXPECT_LT(nearest, 2.0) << lens.label;   // sizes are rounded down to whole pixels
  }
}

TEST(Undistort, SmoothScenePhotographedThroughTheLensComesBack) {
  if (!can_undistort()) GTEST_SKIP() << "built without OpenCV";
  for (const Lens& lens : lenses()) {
    const LensCamera camera = lens_camera(lens.camera, "a.jpg");
    Image8 photo(lens.camera.width, lens.camera.height, 3);
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x) {
        // The ray of this pixel; that undistorted() is right is tested above against `projected`.
        const auto ray = undistorted(camera, {(x + 0.5 - camera.pinhole.cx) / camera.pinhole.fx,
                                              (y + 0.5 - camera.pinhole.cy) / camera.pinhole.fy});
        for (int c = 0; c < 3 && ray; ++c)
          photo.at(x, y, c) = rounded(scene_colour(ray->x, ray->y, c));
      }
    const PinholeCamera<double> pinhole = undistorted_pinhole(camera, "a.jpg");
    const Image8 result = undistorted_photo(photo, camera, pinhole, "a.jpg");
    double sum = 0, worst = 0;
    for (int y = 0; y < result.height; ++y)
      for (int x = 0; x < result.width; ++x)
        for (int c = 0; c < 3; ++c) {
          const double error =
              std::abs(result.at(x, y, c) - scene_colour((x + 0.5 - pinhole.cx) / pinhole.fx,
                                                         (y + 0.5 - pinhole.cy) / pinhole.fy, c));
          worst = std::max(worst, error);
          sum += error;
        }
    // Rounding twice gives 0.3 on the mean and 1.3 at worst. The scene changes by 1 to 4 a pixel:
    // half a pixel off gives 1 on the mean.
    EXPECT_LT(sum / double(result.pixels.size()), 0.4) << lens.label;
    EXPECT_LT(worst, 2) << lens.label;
  }
}

TEST(Undistort, WideFisheyeStopsGrowing) {
  if (!can_undistort()) GTEST_SKIP() << "built without OpenCV";
  // 180 degrees across: as a pinhole it would be endless.
  const ColmapCamera camera = {
      1, CameraModel::opencv_fisheye, 300, 300, {95.5, 95.5, 150, 150, 0, 0, 0, 0}};
  const PinholeCamera<double> pinhole = undistorted_pinhole(lens_camera(camera, "a.jpg"), "a.jpg");
  EXPECT_EQ(pinhole.width, 600);
  EXPECT_EQ(pinhole.height, 600);
}

TEST(Undistort, FoldingPolynomialIsCroppedToItsSoundPart) {
  if (!can_undistort()) GTEST_SKIP() << "built without OpenCV";
  const ColmapCamera camera = {1, CameraModel::simple_radial, 400, 400, {200, 200, 200, -0.3}};
  const LensCamera lens = lens_camera(camera, "a.jpg");
  const PinholeCamera<double> pinhole = undistorted_pinhole(lens, "a.jpg");
  EXPECT_GT(pinhole.width, 100);
  EXPECT_TRUE(is_unfolded(lens, {pinhole.cx / pinhole.fx, pinhole.cy / pinhole.fy}));
}

TEST(Undistort, WhatCannotBeUndistortedNamesModelCameraPhotoAndRemedy) {
  for (CameraModel model : {CameraModel::fov, CameraModel::thin_prism_fisheye, CameraModel::eucm,
                            CameraModel::rad_tan_thin_prism_fisheye, CameraModel::simple_division,
                            CameraModel::division, CameraModel::equirectangular}) {
    const CameraModelInfo& info = camera_model_info(model);
    const std::string message =
        error_of({42, model, 100, 80, std::vector<double>(info.param_count, 50.0)});
    EXPECT_THAT(message, AllOf(HasSubstr(info.name), HasSubstr("camera 42"), HasSubstr("sub/a.jpg"),
                               HasSubstr("colmap image_undistorter")));
  }
  EXPECT_THAT(error_of({1, CameraModel::pinhole, 100, 80, {0, 90, 50, 40}}),
              HasSubstr("focal length"));
}

TEST(Undistort, CoefficientsThatLeaveNoPictureAreAnError) {
  if (!can_undistort()) GTEST_SKIP() << "built without OpenCV";
  EXPECT_THAT(error_of({1, CameraModel::simple_radial, 100, 80, {90, 50, 40, -1e6}}),
              HasSubstr("leave no picture"));
  EXPECT_THAT(error_of({1, CameraModel::simple_radial, 100, 80, {90, 500, 40, 0.1}}),
              HasSubstr("leave no picture"));
}

TEST(Undistort, BuildWithoutOpenCvSaysSo) {
  if (can_undistort()) GTEST_SKIP() << "built with OpenCV";
  EXPECT_THAT(
      error_of({1, CameraModel::simple_radial, 100, 80, {90, 50, 40, 0.1}}),
      AllOf(HasSubstr("no OpenCV"), HasSubstr("colmap image_undistorter"), HasSubstr("sub/a.jpg")));
}

}  // namespace
}  // namespace gs
