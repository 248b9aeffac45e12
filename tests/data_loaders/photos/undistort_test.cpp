// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/lenses/undistort.h"

#include <gmock/gmock.h>

#include <cmath>
#include <cstdlib>
#include <limits>

#include "data_loaders/lenses/resample.h"
#include "gs_core/error.h"
#include "tests/data_loaders/photos/lens_cases.h"
#include "tests/support/error_of.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// The color of a scene in the direction (x, y, 1).
using Scene = double (*)(double x, double y, int channel);

double smooth_scene(double x, double y, int channel) {
  return 128 + 60 * std::sin(9 * x + channel) + 50 * std::cos(7 * y - 3 * x + 2 * channel);
}

/// Squares of 1 / 6, 43 pixels at a focal length of 260; their edges are some 5 pixels wide.
double checkerboard(double x, double y, int channel) {
  const double steep = 4, turns = 6 * 3.14159265358979;
  return 128 + (100 - 20 * channel) * std::tanh(steep * std::sin(turns * x)) *
                   std::tanh(steep * std::sin(turns * y));
}

std::uint8_t rounded(double value) { return std::uint8_t(std::lround(value)); }

std::string error_of(const ColmapCamera& camera) {
  return gs::error_of([&] { undistorted_pinhole(lens_camera(camera, "sub/a.jpg"), "sub/a.jpg"); });
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
  for (const LensCase& lens : lens_cases()) {
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
  for (const LensCase& lens : lens_cases()) {
    const PinholeCamera<double> pinhole =
        undistorted_pinhole(lens_camera(lens.camera, "a.jpg"), "a.jpg");
    double nearest = 1e9;  // distance of the outermost pixels to the photo's border
    for (int y = 0; y < pinhole.height; ++y)
      for (int x = 0; x < pinhole.width; ++x) {
        const Vec2d at = projected(lens.camera, (x + 0.5 - pinhole.cx) / pinhole.fx,
                                   (y + 0.5 - pinhole.cy) / pinhole.fy, 1);
        const double inside =
            std::min({at.x, lens.camera.width - at.x, at.y, lens.camera.height - at.y});
        nearest = std::min(nearest, inside);
      }
    EXPECT_GT(nearest, 0.49) << lens.label;  // the outermost pixel centers of the photo lie at 0.5
    EXPECT_LT(nearest, 2.0) << lens.label;   // sizes are rounded down to whole pixels
  }
}

struct Difference {
  double mean, worst;  // of 255
};

/// The difference between the scene photographed through the lens and undistorted, and the scene
/// seen by the pinhole.
Difference difference(const LensCase& lens, Scene scene) {
  const LensCamera camera = lens_camera(lens.camera, "a.jpg");
  Image8 photo(lens.camera.width, lens.camera.height, 3);
  for (int y = 0; y < photo.height; ++y)
    for (int x = 0; x < photo.width; ++x) {
      // The ray of this pixel; lens_test.cpp tests undistorted() against `projected`.
      const auto ray = undistorted(camera, {(x + 0.5 - camera.pinhole.cx) / camera.pinhole.fx,
                                            (y + 0.5 - camera.pinhole.cy) / camera.pinhole.fy});
      for (int c = 0; c < 3 && ray; ++c) photo.at(x, y, c) = rounded(scene(ray->x, ray->y, c));
    }
  const PinholeCamera<double> pinhole = undistorted_pinhole(camera, "a.jpg");
  const Image8 result = undistorted_photo(photo, camera, pinhole, "a.jpg");
  double sum = 0, worst = 0;
  for (int y = 0; y < result.height; ++y)
    for (int x = 0; x < result.width; ++x)
      for (int c = 0; c < 3; ++c) {
        const double error =
            std::abs(result.at(x, y, c) - scene((x + 0.5 - pinhole.cx) / pinhole.fx,
                                                (y + 0.5 - pinhole.cy) / pinhole.fy, c));
        worst = std::max(worst, error);
        sum += error;
      }
  return {sum / double(result.pixels.size()), worst};
}

TEST(Undistort, SmoothScenePhotographedThroughTheLensComesBack) {
  for (const LensCase& lens : lens_cases()) {
    const Difference found = difference(lens, smooth_scene);
    // Rounding twice gives a mean of 0.3 and at most 1.3. The scene changes by 1 to 4 per pixel, so
    // an error of half a pixel gives a mean of 1.
    EXPECT_LT(found.mean, 0.4) << lens.label;
    EXPECT_LT(found.worst, 2) << lens.label;
  }
}

TEST(Undistort, CheckerboardPhotographedThroughTheLensComesBack) {
  for (const LensCase& lens : lens_cases())
    EXPECT_LT(difference(lens, checkerboard).mean, 1.0) << lens.label;
}

TEST(Undistort, WideFisheyeStopsGrowing) {
  // A field of view of 180 degrees: its pinhole picture would be infinite.
  const ColmapCamera camera = {
      1, CameraModel::opencv_fisheye, 300, 300, {95.5, 95.5, 150, 150, 0, 0, 0, 0}};
  const PinholeCamera<double> pinhole = undistorted_pinhole(lens_camera(camera, "a.jpg"), "a.jpg");
  EXPECT_EQ(pinhole.width, 600);
  EXPECT_EQ(pinhole.height, 600);
}

TEST(Undistort, FoldingPolynomialIsCroppedToItsSoundPart) {
  const ColmapCamera camera = {1, CameraModel::simple_radial, 400, 400, {200, 200, 200, -0.3}};
  const LensCamera lens = lens_camera(camera, "a.jpg");
  const PinholeCamera<double> pinhole = undistorted_pinhole(lens, "a.jpg");
  EXPECT_GT(pinhole.width, 100);
  EXPECT_TRUE(is_unfolded(lens, {pinhole.cx / pinhole.fx, pinhole.cy / pinhole.fy}));
}

TEST(Undistort, TooWideAFieldOfViewNamesModelPhotoFieldAndRemedy) {
  // A field of view of 220 degrees: twice the size at the same focal length ends 75.4 degrees from
  // the axis.
  const std::string message = error_of({1, CameraModel::simple_fisheye, 384, 384, {100, 192, 192}});
  EXPECT_THAT(message, AllOf(HasSubstr("SIMPLE_FISHEYE"), HasSubstr("sub/a.jpg"),
                             HasSubstr("151 x 151 degrees"), HasSubstr("Crop the photos"),
                             HasSubstr("colmap image_undistorter"), HasSubstr("--max_scale 1")));
}

TEST(Undistort, CoefficientsThatLeaveNoPictureAreAnError) {
  EXPECT_THAT(error_of({1, CameraModel::simple_radial, 100, 80, {90, 50, 40, -1e6}}),
              AllOf(HasSubstr("leave no picture"), HasSubstr("SIMPLE_RADIAL")));
  EXPECT_THAT(error_of({1, CameraModel::simple_radial, 100, 80, {90, 500, 40, 0.1}}),
              HasSubstr("leave no picture"));
}

TEST(Undistort, OwnResamplerAgreesWithTheOneOfTheBuild) {
  Image8 photo(40, 30, 3);
  for (int y = 0; y < photo.height; ++y)
    for (int x = 0; x < photo.width; ++x)
      for (int c = 0; c < 3; ++c) photo.at(x, y, c) = rounded(checkerboard(x / 40.0, y / 40.0, c));
  // Positions on a grid of 1/32 pixel, which OpenCV does not round, inside and beyond the border.
  PhotoPositions positions(101, 79);
  for (int i = 0; i < 101 * 79; ++i) {
    positions.x[i] = float(i % 101) * 15 / 32 - 4;
    positions.y[i] = float(i / 101) * 15 / 32 - 4;
  }
  Image8 expected(101, 79, 3), found(101, 79, 3);
  resample(photo, positions, expected.pixels.data());
  resample_bicubic(photo, positions, found.pixels.data());
  int worst = 0;
  for (std::size_t i = 0; i < found.pixels.size(); ++i)
    worst = std::max(worst, std::abs(int(found.pixels[i]) - int(expected.pixels[i])));
  EXPECT_LE(worst, 1);  // weights are rounded differently
  EXPECT_EQ(found.at(0, 0, 1), photo.at(0, 0, 1)) << "beyond the border";
}

TEST(Undistort, ResamplingAtPixelsCopiesThem) {
  Image8 photo(3, 2, 1);
  photo.pixels = {0, 255, 7, 19, 128, 250};
  PhotoPositions positions(3, 2);
  for (int i = 0; i < 6; ++i) {
    positions.x[i] = float(i % 3);
    positions.y[i] = float(i / 3);
  }
  Image8 found(3, 2, 1);
  resample_bicubic(photo, positions, found.pixels.data());
  EXPECT_EQ(found.pixels, photo.pixels);
  for (float& x : positions.x) x = std::numeric_limits<float>::quiet_NaN();
  resample_bicubic(photo, positions, found.pixels.data());
  EXPECT_EQ(found.pixels, (std::vector<std::uint8_t>{0, 0, 0, 19, 19, 19}));
}

}  // namespace
}  // namespace gs
