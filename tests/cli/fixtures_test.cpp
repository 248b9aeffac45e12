// SPDX-License-Identifier: Apache-2.0
// Files that older versions have written (tests/fixtures) are read: their runs go on to their end,
// and every model, result and small file of theirs is understood.
#include <gmock/gmock.h>

#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// Training differs in last bits between compilers and processors, and a decision of density control
/// may then fall the other way: 40 steps on six tiny photos then end so far from the recorded run.
constexpr double kMostPsnr = 0.5;       // dB
constexpr double kMostGaussians = 0.1;  // share

std::vector<std::string> versions() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(fs::path(GS_SOURCE_DIR) / "tests/fixtures"))
    if (entry.is_directory()) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

class Fixtures : public Program, public ::testing::WithParamInterface<std::string> {
 protected:
  void SetUp() override {
    fs::copy(fs::path(GS_SOURCE_DIR) / "tests/fixtures" / GetParam(), path(""),
             fs::copy_options::recursive);
    about_ = json("about.json");
  }
  Outcome expect_done(const std::string& arguments) {
    Outcome outcome = run(arguments);
    EXPECT_EQ(outcome.code, 0) << arguments << "\n" << outcome.err;
    return outcome;
  }
  bool has(const std::string& name) const { return fs::exists(path(name)); }

  SortedJson about_;
};

TEST_P(Fixtures, ARunThatWasCutOffGoesOnToItsEnd) {
  const Outcome outcome =
      expect_done("train " + text("scene") + " -o " + text("run") + " --resume auto");
  EXPECT_THAT(outcome.err,
              HasSubstr("goes on after step " + std::to_string(about_.at("cut_after").get<int>())));
  EXPECT_FALSE(has("run/checkpoints/step_20.ckpt.refused"));
  const SortedJson now = json("run/results.json"), then = json("whole/results.json");
  EXPECT_EQ(now.at("iterations"), about_.at("steps"));
  const double gaussians = then.at("num_gaussians").get<double>();
  EXPECT_NEAR(now.at("num_gaussians").get<double>(), gaussians, kMostGaussians * gaussians);
  for (const char* split : {"train", "test"})
    EXPECT_NEAR(now.at(split).at("psnr").get<double>(), then.at(split).at("psnr").get<double>(),
                kMostPsnr)
        << split;
}

TEST_P(Fixtures, EveryModelIsRead) {
  ASSERT_FALSE(about_.at("models").empty());
  for (const auto& [name, said] : about_.at("models").items()) {
    const Outcome outcome = run("info --json " + text(name));
    if (outcome.code == 3 && outcome.err.find("this build") != std::string::npos &&
        !name.ends_with(".ply"))
      continue;  // it has no zlib or libwebp
    ASSERT_EQ(outcome.code, 0) << name << "\n" << outcome.err;
    const auto info = SortedJson::parse(outcome.out);
    EXPECT_EQ(info.at("count"), said.at("count")) << name;
    EXPECT_EQ(info.at("sh_degree"), said.at("sh_degree")) << name;
    expect_done("edit " + text(name) + " -o " + text("again.ply") + " --move 1,2,3 --force");
  }
}

TEST_P(Fixtures, AFinishedRunIsMeasuredAndShown) {
  const Outcome eval = expect_done("eval " + text("whole") + " -d " + text("scene") +
                                   " --device cpu -o " + text("eval.json"));
  EXPECT_NEAR(json("eval.json").at("psnr").get<double>(),
              json("whole/results.json").at("test").at("psnr").get<double>(), 0.01)
      << "the model is the same, and only the rendering may differ in last bits";
  expect_done("config diff " + text("whole") + " " + text("whole"));
  expect_done("train " + text("scene") + " -o " + text("new") + " --iterations 2 -c " +
              text("whole") + " --from " + text("whole"));
  expect_done("render " + text("whole") + " --device cpu -o " + text("views") + " -d " +
              text("scene"));
  expect_done("render " + text("whole") + " --device cpu -o " + text("path") +
              " --frames 3 --path " + text("path.json"));
  if (has("whole/photometric.json"))
    expect_done("render " + text("whole") + " --device cpu -o " + text("like") +
                " --like view_1.png");
}

TEST_P(Fixtures, APlaceOnEarthIsUnderstood) {
  if (!has("georef.json")) GTEST_SKIP() << "this version had no georeferences";
  expect_done("export " + text("whole") + " " + text("tiles/") + " --georef " +
              text("georef.json"));
  EXPECT_TRUE(has("tiles/tileset.json"));
}

INSTANTIATE_TEST_SUITE_P(Versions, Fixtures, ::testing::ValuesIn(versions()), [](const auto& info) {
  std::string name = info.param;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return !std::isalnum(c); }, '_');
  return "v" + name;
});

}  // namespace
}  // namespace gs
