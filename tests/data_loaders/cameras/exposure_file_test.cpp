// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/cameras/exposure_file.h"

#include <gmock/gmock.h>

#include "gs_core/error.h"
#include "tests/support/error_of.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

View view_named(const std::string& name, const Vec3f& exposure) {
  View view;
  view.name = name;
  view.exposure = exposure;
  return view;
}

TEST(ExposureFile, BringsBackEveryFloatOfTrainingAndTestViews) {
  const TempFolder temp;
  Scene scene;
  scene.train_views = {view_named("a/one \"two\".png", {1.1f, 0.9f, 1.0f / 3})};
  scene.test_views = {view_named("b.png", {1, 2, 3})};
  write_exposures(temp.path() / "exposure.json", scene);
  Scene read = scene;
  read.train_views[0].exposure = read.test_views[0].exposure = Vec3f(1);
  read.train_views.push_back(view_named("new.png", {5, 5, 5}));
  apply_exposures(read_exposures(temp.path() / "exposure.json"), read);
  EXPECT_EQ(read.train_views[0].exposure, scene.train_views[0].exposure);
  EXPECT_EQ(read.test_views[0].exposure, Vec3f(1, 2, 3));
  EXPECT_EQ(read.train_views[1].exposure, Vec3f(5));  // not in the file
}

TEST(ExposureFile, DamageIsNamedWithThePhoto) {
  const TempFolder temp;
  const std::pair<const char*, const char*> cases[] = {
      {"", "JSON"},
      {"[1]", "not a list"},
      {"{\"a.png\": [1, 2]}", "a.png"},
      {"{\"a.png\": [1, 2, 0]}", "a.png"},
      {"{\"a.png\": [1, 2, \"x\"]}", "a.png"},
      {"{\"a.png\": 1}", "a.png"},
      {"{\"a.png\": [1, 2, 1e99]}", "JSON"},
  };
  for (const auto& [text, named] : cases) {
    write_bytes(temp.path() / "exposure.json", text);
    EXPECT_THAT(error_of([&] { read_exposures(temp.path() / "exposure.json"); }),
                AllOf(HasSubstr("exposure.json"), HasSubstr("train again"), HasSubstr(named)))
        << text;
  }
}

}  // namespace
}  // namespace gs
