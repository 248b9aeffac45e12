// SPDX-License-Identifier: Apache-2.0
// Models that are made to fit into a file of a size.
#include "gs_app/export/fit_size.h"

#include <gtest/gtest.h>

#include "gs_app/export/export_model.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"
#include "tests/support/random_model.h"
#include "tests/support/same_bits.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

constexpr std::size_t kCount = 2000;

// As a file without compression has it: a header, and floats for each Gaussian.
std::uint64_t plain_size(const GaussianModel& model) {
  const int bases = (model.sh_degree + 1) * (model.sh_degree + 1);
  return 100 + model.gaussians.count() * std::size_t(11 + 3 * bases) * 4;
}

GaussianModel fit(const GaussianModel& model, std::uint64_t bytes) {
  return fit_size(model, bytes, plain_size, nullptr, "a.ply");
}

class FitSize : public FolderTest {
 protected:
  const GaussianModel model_ = random_model(kCount, 3);
  const std::uint64_t whole_ = plain_size(model_);
};

TEST_F(FitSize, AModelThatFitsIsTheSame) {
  const GaussianModel same = fit(model_, whole_);
  EXPECT_EQ(same.sh_degree, 3);
  EXPECT_TRUE(same_bits(same.gaussians.mean, model_.gaussians.mean));
}

// 236 bytes each with degree 3, and 152, 92 and 56 below it.
TEST_F(FitSize, WithoutViewsTheDegreeFollowsTheShareOfGaussians) {
  const auto degree_at = [&](double share) {
    const GaussianModel fitted = fit(model_, std::uint64_t(share * double(whole_)));
    EXPECT_LE(plain_size(fitted), share * double(whole_));
    EXPECT_GE(plain_size(fitted), 0.9 * share * double(whole_));
    return fitted.sh_degree;
  };
  EXPECT_EQ(degree_at(0.9), 3);
  EXPECT_EQ(degree_at(0.4), 2);
  EXPECT_EQ(degree_at(0.15), 2);
  EXPECT_EQ(degree_at(0.06), 1);
  EXPECT_EQ(degree_at(0.03), 0);
}

TEST_F(FitSize, ViewsTellWhetherColorsOrGaussiansAreWorthMore) {
  const Camera camera = plain_camera(64, 64);
  GaussianModel model;
  model.gaussians = random_gaussians(kTypical, kCount, camera, 3);
  for (ShRest& rest : model.gaussians.sh_rest) rest = {};  // all colors are those of degree 0
  const std::unique_ptr<Backend> backend = make_scalar_backend();
  Viewpoints views{*backend, model.gaussians.span(), {}, {camera}};
  views.training = [&] { return std::vector<Camera>{camera}; };
  const GaussianModel fitted = fit_size(model, plain_size(model) / 3, plain_size, &views, "a.ply");
  EXPECT_EQ(fitted.sh_degree, 0);
  EXPECT_EQ(fitted.gaussians.count(), kCount);  // which needs less than a third
}

TEST_F(FitSize, TooFewBytesAreAnErrorWithARemedy) {
  const std::string error = error_of([&] { fit(model_, 2000); });
  EXPECT_TRUE(error.starts_with("a.ply cannot have ")) << error;
  EXPECT_NE(error.find("larger --megabytes"), std::string::npos) << error;
}

TEST_F(FitSize, GaussiansThatMoveLoseColorsAlone) {
  const GaussianModel moving = random_moving_model(kCount, 3);
  const GaussianModel fitted = fit(moving, plain_size(moving) / 2);
  EXPECT_EQ(fitted.sh_degree, 1);
  EXPECT_EQ(fitted.gaussians.count(), kCount);
  EXPECT_NE(error_of([&] { fit(moving, 5000); }).find("--decimate-by drop"), std::string::npos);
}

TEST_F(FitSize, AnExportedFileHasAtMostTheSize) {
  ExportRequest request{path("a.spz")};
  request.most_bytes = 20'000;
  request.transform.scale = 3;
  const ExportedFile file = export_model(model_, request);
  EXPECT_EQ(file.bytes, std::filesystem::file_size(path("a.spz")));
  EXPECT_LE(file.bytes, request.most_bytes);
  EXPECT_GE(file.bytes, request.most_bytes * 9 / 10);
  EXPECT_EQ(file.format->read(path("a.spz")).gaussians.count(), file.gaussians);
}

}  // namespace
}  // namespace gs
