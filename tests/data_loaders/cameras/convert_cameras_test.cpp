// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/refine/convert_cameras.h"

#include <gmock/gmock.h>

#include "gs_core/error.h"
#include "tests/data_loaders/photos/lens_cases.h"
#include "tests/support/colmap_writer.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const ColmapCamera kRadial{1, CameraModel::radial, 320, 240, {260, 163, 117, -0.12, 0.03}};

TEST(FitCamera, OpencvIsRadialToAHundredthOfAPixel) {
  const FittedCamera fit = fit_camera(kRadial, CameraModel::opencv, "a.jpg");
  EXPECT_LT(fit.max_error, 0.01);
  EXPECT_LE(fit.mean_error, fit.max_error);
  EXPECT_EQ(fit.unseen_share, 0);
  const double expected[] = {260, 260, 163, 117, -0.12, 0.03, 0, 0};
  for (int i = 0; i < 8; ++i)
    EXPECT_NEAR(fit.camera.params[std::size_t(i)], expected[i], 1e-3) << i;
}

TEST(FitCamera, StatedErrorIsThatOfIndependentProjections) {
  for (const CameraModel target : {CameraModel::opencv, CameraModel::pinhole}) {
    const ColmapCamera from{1, CameraModel::division, 320, 240, {260, 255, 158, 122, 0.12}};
    const FittedCamera fit = fit_camera(from, target, "a.jpg");
    double most = 0;
    for (double y = -0.6; y <= 0.6; y += 0.01)
      for (double x = -0.7; x <= 0.7; x += 0.01) {
        const Vec2d a = projected(from, x, y, 1);
        if (a.x < 0.5 || a.y < 0.5 || a.x > 319.5 || a.y > 239.5) continue;
        const std::vector<double>& p = fit.camera.params;
        const Vec2d b = target == CameraModel::opencv ? projected(fit.camera, x, y, 1)
                                                      : Vec2d(p[0] * x + p[2], p[1] * y + p[3]);
        most = std::max(most, std::hypot(a.x - b.x, a.y - b.y));
      }
    EXPECT_LE(most, 1.05 * fit.max_error);
    EXPECT_GT(most, 0.5 * fit.max_error);
    EXPECT_EQ(fit.max_error > 1, target == CameraModel::pinhole);
  }
}

TEST(FitCamera, PictureThatShowsWhatLiesBesideTheCameraHasAnUnseenShare) {
  const ColmapCamera wide{1, CameraModel::simple_fisheye, 320, 240, {90, 160, 120}};  // 204 degrees
  EXPECT_GT(fit_camera(wide, CameraModel::opencv, "a.jpg").unseen_share, 0.01);
}

ColmapModel radial_model() {
  ColmapModel model = small_model(2);
  model.cameras[7] = {7, CameraModel::radial, 320, 240, kRadial.params};
  model.images[0].observations = {{5, 1.5, 2.5}};
  return model;
}

TEST(ConvertCameras, ChangesCamerasAndNothingElseInBothEncodings) {
  for (const bool binary : {true, false}) {
    const TempFolder temp;
    const auto from = temp.path() / "from", to = temp.path() / "new" / "to";
    (binary ? write_binary_model : write_text_model)(from, radial_model());
    const auto fits = convert_cameras(from, to, CameraModel::opencv, 1);
    ASSERT_EQ(fits.size(), 1u);
    const ColmapModel read = read_colmap_model(to);
    EXPECT_EQ(read.cameras.at(7).model, CameraModel::opencv);
    EXPECT_EQ(read.cameras.at(7).params, fits[0].camera.params);
    for (const char* stem : {"images", "points3D"}) {
      const std::string name = stem + std::string(binary ? ".bin" : ".txt");
      EXPECT_EQ(read_bytes(to / name), read_bytes(from / name)) << name;
    }
  }
}

TEST(ConvertCameras, NeverOverwritesAndRefusesBadFitsBeforeItWrites) {
  const TempFolder temp;
  const auto from = temp.path() / "from", to = temp.path() / "to";
  write_binary_model(from, radial_model());
  const std::string before = read_bytes(from / "cameras.bin");
  EXPECT_THROW(convert_cameras(from, from, CameraModel::opencv, 1), UsageError);
  EXPECT_EQ(read_bytes(from / "cameras.bin"), before);
  try {
    convert_cameras(from, to, CameraModel::pinhole, 1);
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("camera 7 (RADIAL) cannot become PINHOLE"),
                                    HasSubstr("--camera-model OPENCV or --max-error")));
  }
  EXPECT_FALSE(std::filesystem::exists(to));
  convert_cameras(from, to, CameraModel::pinhole, 1000);
  EXPECT_EQ(read_colmap_model(to).cameras.at(7).model, CameraModel::pinhole);
}

}  // namespace
}  // namespace gs
