// SPDX-License-Identifier: Apache-2.0
// The findings of `gemsplat info`: known numbers, and each suspicion by itself.
#include "gs_model/formats/model_info.h"

#include <gmock/gmock.h>

#include <cmath>

#include "gs_core/math/random.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

using testing::HasSubstr;
using testing::Not;

/// A thousand Gaussians without faults: uniform in the unit cube, scale 0.01, opacity 0.5.
GaussianModel sound_model(int sh_degree = 1, std::size_t count = 1000) {
  GaussianModel model;
  model.sh_degree = sh_degree;
  model.gaussians.resize(count);
  model.gaussians.fill_zero();
  for (std::size_t i = 0; i < count; ++i) {
    const Vec4f u = Random{3, RandomStream::test}.uniform4(i);
    model.gaussians.mean[i] = {u.x, u.y, u.z};
    model.gaussians.log_scale[i] = Vec3f(std::log(0.01f));
    model.gaussians.rotation[i] = {1, 0, 0, 0};
    if (sh_degree > 0) model.gaussians.sh_rest[i].coefficient[0].x = 0.1f;
  }
  return model;
}

std::size_t count_of(const ModelInfo& info, const std::string& key) {
  for (const Suspicion& suspicion : info.suspicions) {
    if (suspicion.key == key) return suspicion.count;
  }
  return 0;
}

/// Expects the model to show this suspicion, this often, and no other one.
void expect_only(const GaussianModel& model, const std::string& key, std::size_t count) {
  const ModelInfo info = inspect(model);
  EXPECT_EQ(count_of(info, key), count);
  EXPECT_EQ(info.suspicions.size(), 1u) << describe(info);
}

TEST(ModelInfo, SoundModelHasKnownNumbersAndNoSuspicion) {
  GaussianModel model = sound_model();
  model.antialiased = true;
  for (int i = 0; i < 100; ++i) model.gaussians.logit_opacity[i] = -6;       // 0.0025
  for (int i = 100; i < 300; ++i) model.gaussians.logit_opacity[i] = -3.5f;  // 0.029
  for (int i = 300; i < 700; ++i) model.gaussians.logit_opacity[i] = 3;      // 0.95
  const ModelInfo info = inspect(model);
  EXPECT_EQ(info.count, 1000u);
  EXPECT_EQ(info.sh_degree, 1);
  EXPECT_TRUE(info.antialiased);
  EXPECT_EQ(info.bytes, 236'000u);
  EXPECT_FLOAT_EQ(info.faint_share, 0.1f);
  EXPECT_FLOAT_EQ(info.thin_share, 0.3f);
  EXPECT_FLOAT_EQ(info.solid_share, 0.4f);
  EXPECT_NEAR(info.median_scale, 0.01f, 1e-6f);
  EXPECT_TRUE(info.suspicions.empty()) << describe(info);
  EXPECT_THAT(describe(info), HasSubstr("suspicious:    nothing"));
}

TEST(ModelInfo, PercentilesAndBoundsAreTakenPerAxis) {
  GaussianModel model = sound_model(1, 101);
  for (int i = 0; i <= 100; ++i) {
    model.gaussians.mean[i] = {float(i), float(100 - i) - 50, 2.0f * float(i)};
  }
  const ModelInfo info = inspect(model);
  EXPECT_EQ(info.min, Vec3f(0, -50, 0));
  EXPECT_EQ(info.max, Vec3f(100, 50, 200));
  EXPECT_EQ(info.inner_min, Vec3f(1, -49, 2));
  EXPECT_EQ(info.inner_max, Vec3f(99, 49, 198));
}

TEST(ModelInfo, NonFiniteRowsAreCountedByQuantityAndLeftOut) {
  GaussianModel model = sound_model();
  model.gaussians.mean[0].x = NAN;
  model.gaussians.log_scale[0].x = INFINITY;
  model.gaussians.log_scale[1].z = -INFINITY;
  model.gaussians.sh_rest[2].coefficient[14].z = NAN;
  expect_only(model, "non_finite", 3);
  const ModelInfo info = inspect(model);
  EXPECT_THAT(info.suspicions[0].sentence, HasSubstr("(mean 1, log_scale 2, sh_rest 1)"));
  EXPECT_LE(info.max.x, 1);
}

TEST(ModelInfo, ZeroQuaternions) {
  GaussianModel model = sound_model();
  model.gaussians.rotation[5] = {0, 0, 0, 0};
  expect_only(model, "zero_quaternions", 1);
}

TEST(ModelInfo, HugeScalesEvenWhereExpOverflows) {
  GaussianModel model = sound_model();
  model.gaussians.log_scale[5] = Vec3f(2.0f);  // 7.4 in a scene 1.7 across
  model.gaussians.log_scale[6] = Vec3f(200.0f);
  expect_only(model, "huge_scales", 2);
}

TEST(ModelInfo, ZeroScales) {
  GaussianModel model = sound_model();
  model.gaussians.log_scale[5] = Vec3f(-90.0f);
  expect_only(model, "zero_scales", 1);
}

TEST(ModelInfo, MoreNeedlesThanTrainedModelsHave) {
  GaussianModel model = sound_model();
  for (int i = 0; i < 250; ++i) model.gaussians.log_scale[i].x -= 5;  // 148 times thinner
  EXPECT_TRUE(inspect(model).suspicions.empty());
  for (int i = 0; i < 350; ++i) model.gaussians.log_scale[i].x = std::log(0.01f) - 5;
  expect_only(model, "needles", 350);
  EXPECT_THAT(describe(inspect(model)), HasSubstr("350 (35.0 %)"));
}

TEST(ModelInfo, FarOutliers) {
  GaussianModel model = sound_model();
  model.gaussians.mean[5] = {0, 0, 30};
  expect_only(model, "far_outliers", 1);
}

TEST(ModelInfo, CoordinatesTooLargeForFloat) {
  GaussianModel model = sound_model();
  for (std::size_t i = 0; i < model.gaussians.count(); ++i) {
    model.gaussians.mean[i].x = 500'000 + float(i);  // float steps of 0.03
  }
  expect_only(model, "imprecise", 1000);
}

TEST(ModelInfo, DuplicatePositions) {
  GaussianModel model = sound_model();
  for (const int i : {5, 6, 7}) model.gaussians.mean[i] = model.gaussians.mean[4];
  expect_only(model, "duplicates", 3);
}

TEST(ModelInfo, ShRestAllZero) {
  EXPECT_TRUE(inspect(sound_model(0)).suspicions.empty());
  GaussianModel model = sound_model(0);
  model.sh_degree = 3;
  expect_only(model, "sh_rest_all_zero", 1000);
}

TEST(ModelInfo, EmptyAndHopelessModelsAreDescribed) {
  GaussianModel model;
  EXPECT_EQ(count_of(inspect(model), "empty"), 1u);
  EXPECT_THAT(describe(inspect(model)), HasSubstr("there are no Gaussians"));
  model = sound_model(1, 3);
  for (Vec3f& mean : model.gaussians.mean) mean.x = NAN;
  expect_only(model, "non_finite", 3);
}

TEST(ModelInfo, OneGaussianIsNotSuspicious) {
  EXPECT_TRUE(inspect(sound_model(1, 1)).suspicions.empty());
}

TEST(ModelInfo, AFilterThatWasAppliedIsNamed) {
  ModelInfo info = inspect(sound_model());
  EXPECT_THAT(describe(info), Not(HasSubstr("filter_3D")));
  info.had_filter_3d = true;
  EXPECT_THAT(describe(info), HasSubstr("filter_3D, applied to scales and opacities"));
}

TEST(ModelInfo, JsonHoldsTheSameNumbers) {
  GaussianModel model = sound_model();
  model.gaussians.rotation[5] = {0, 0, 0, 0};
  model.gaussians.log_scale[6] = Vec3f(89.0f);
  const ModelInfo info = inspect(model);
  const auto json = SortedJson::parse(to_json_text(info));
  EXPECT_EQ(json["count"], 1000);
  EXPECT_EQ(json["sh_degree"], 1);
  EXPECT_EQ(json["antialiased"], false);
  EXPECT_EQ(json["had_filter_3d"], false);
  EXPECT_EQ(json["max"][2].get<float>(), info.max.z);
  EXPECT_EQ(json["median_scale"].get<float>(), info.median_scale);
  EXPECT_EQ(json["suspicions"]["zero_quaternions"], 1);
  EXPECT_EQ(json["suspicions"]["huge_scales"], 1);
  EXPECT_THAT(to_json_text(info), Not(HasSubstr("null")));
}

}  // namespace
}  // namespace gs
