// SPDX-License-Identifier: Apache-2.0
// Exposures and gains of photos: what a run writes about them, and what `eval` and `doctor` say.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/refine/refine_exposure.h"
#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST_F(Program, ExposuresAndRefinedCamerasAreReportedAndAppliedAgain) {
  if (!can_refine()) GTEST_SKIP() << "this build has no Ceres";
  write_scene(path("scene"), true);
  const Outcome trained = train("out", "--exposure --refine-cameras");
  ASSERT_EQ(trained.code, 0) << trained.err;
  EXPECT_THAT(trained.out, HasSubstr("under their exposures"));
  EXPECT_EQ(json("out/exposure.json").size(), std::size_t(kViews));
  const SortedJson results = json("out/results.json");
  EXPECT_LT(results.at("refinement").at("mean_error_after"), 0.01);
  EXPECT_GT(results.at("exposure").at("samples"), 100);
  const Outcome again = run("eval " + text("out") + " --device cpu --json");
  ASSERT_EQ(again.code, 0) << again.err;
  EXPECT_THAT(again.err, Not(HasSubstr("exposures from")));  // those of the run, not solved anew
  const auto figures = SortedJson::parse(again.out);
  for (const char* key : {"psnr", "psnr_exposure", "ssim_exposure", "flip_exposure"})
    EXPECT_NEAR(figures.at(key), results.at("test").at(key), 1e-6) << key;

  const Outcome without = train("plain");
  EXPECT_FALSE(fs::exists(path("plain/exposure.json")));
  EXPECT_FALSE(json("plain/results.json").at("test").contains("psnr_exposure"));
}

TEST_F(Program, GainsOfPhotosAreWrittenDownMeasuredApartAndAppliedAgain) {
  write_scene(path("scene"), true);
  const Outcome trained = train("out", "--set photometric.model=gains");
  ASSERT_EQ(trained.code, 0) << trained.err;
  EXPECT_THAT(trained.out, HasSubstr("as the photometric model shows them"));
  const SortedJson looks = json("out/photometric.json"), results = json("out/results.json");
  EXPECT_EQ(looks.at("model"), "gains");
  EXPECT_EQ(looks.at("photos").size() + looks.at("held_out").size(), std::size_t(kViews));
  EXPECT_EQ(looks.at("rule"), results.at("photometric").at("rule"));
  const Outcome again = run("eval " + text("out") + " --device cpu --json");
  ASSERT_EQ(again.code, 0) << again.err;
  const auto figures = SortedJson::parse(again.out);
  for (const char* key : {"psnr", "psnr_photometric", "ssim_photometric", "psnr_cc", "ssim_cc"})
    EXPECT_NEAR(figures.at(key), results.at("test").at(key), 1e-6) << key;

  const Outcome without = train("plain");
  EXPECT_FALSE(fs::exists(path("plain/photometric.json")));
  for (const char* key : {"psnr_photometric", "psnr_cc"})
    EXPECT_FALSE(json("plain/results.json").at("test").contains(key)) << key;
  const Outcome corrected = run("eval " + text("plain") + " --device cpu --json --color-corrected");
  EXPECT_TRUE(SortedJson::parse(corrected.out).contains("psnr_cc"));
}

/// Replaces the photos of write_scene() by gray ones, where every second one is so many times as
/// bright.
void paint_gray(const fs::path& images, double times) {
  for (int v = 0; v < kViews; ++v) {
    Image8 photo(kWidth, kHeight, 3);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        for (int c = 0; c < 3; ++c)
          photo.at(x, y, c) = std::uint8_t((80 + y + 10 * c) * (v % 2 ? times : 1));
    write_png(images / ("view_" + std::to_string(v) + ".png"), photo);
  }
}

TEST_F(Program, PhotosChooseThePhotometricModelAndTheLogAndTheDoctorSayWhy) {
  if (!can_refine()) GTEST_SKIP() << "this build has no Ceres";
  write_scene(path("scene"), true);
  paint_gray(path("scene/images"), 1.4);
  const Outcome varied = train("varied", "--set photometric.model=auto");
  ASSERT_EQ(varied.code, 0) << varied.err;
  EXPECT_THAT(varied.err, HasSubstr("photometric.model auto is gains: the photos differ in light"));
  EXPECT_EQ(json("varied/photometric.json").at("model"), "gains");
  EXPECT_THAT(read_bytes(path("varied/config.toml")),
              AllOf(HasSubstr("model = \"gains\""), Not(HasSubstr("exposure = true"))));
  EXPECT_THAT(run("doctor " + text("scene") + " -q").out,
              HasSubstr("light        the photos differ in light: a point's colors differ by"));
  // The same command goes on with what was chosen.
  EXPECT_EQ(train("varied", "--set photometric.model=auto --resume auto --iterations +2").code, 0);
  EXPECT_EQ(json("varied/photometric.json").at("model"), "gains");

  paint_gray(path("scene/images"), 1);
  const Outcome even = train("even", "--set photometric.model=auto");
  ASSERT_EQ(even.code, 0) << even.err;
  EXPECT_THAT(even.err,
              HasSubstr("photometric.model auto is none: the photos hardly differ in light"));
  EXPECT_FALSE(fs::exists(path("even/photometric.json")));
  // Exposures that only the choice asked for are forgotten, unless the user wants them, too.
  for (const char* run : {"varied", "even"}) {
    EXPECT_FALSE(fs::exists(path(run + std::string("/exposure.json")))) << run;
    EXPECT_FALSE(json(run + std::string("/results.json")).at("test").contains("psnr_exposure"));
  }
  ASSERT_EQ(train("both", "--set photometric.model=auto --exposure").code, 0);
  EXPECT_TRUE(fs::exists(path("both/exposure.json")));
  EXPECT_THAT(run("doctor " + text("scene") + " -q").out,
              HasSubstr("ok   light        the photos hardly differ in light"));
}

TEST_F(Program, WithoutTracksAShortRunMeasuresTheLightAndSaysSo) {
  write_scene(path("scene"));
  const Outcome outcome = train("out", "--set photometric.model=auto");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("photometric.model auto is none: the photos hardly differ in "
                                     "light: gains differ by"));
  EXPECT_THAT(run("doctor " + text("scene") + " -q").out, HasSubstr("it is not known how much"));
}

TEST_F(Program, DamagedPhotometricFileIsNamedWithARemedy) {
  write_scene(path("scene"));
  ASSERT_EQ(train("out", "--set photometric.model=gains").code, 0);
  const std::string whole = read_bytes(path("out/photometric.json"));
  for (const std::string& damage :
       {std::string("{"), std::string("[]"), std::string(R"({"model": "none"})"),
        std::string(R"({"model": "auto"})"),
        std::string(R"({"model": "gains", "photos": {"a": {"camera": -1}}})"),
        std::string(
            R"({"model": "gains", "vignetting": true, "photos": {}})"),  // of older versions
        std::string(R"({"model": "gains", "photos": {"a": {"camera": 1e30}}})"),
        whole.substr(0, whole.size() / 2)}) {
    write_bytes(path("out/photometric.json"), damage);
    const Outcome outcome = run("eval " + text("out") + " --device cpu");
    EXPECT_NE(outcome.code, 0) << damage;
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("photometric.json"), HasSubstr("remove the file")))
        << damage;
  }
}

}  // namespace
}  // namespace gs
