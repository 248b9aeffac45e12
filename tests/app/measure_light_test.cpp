// SPDX-License-Identifier: Apache-2.0
// What photometric.model = "auto" finds in photos without tracks.
#include "gs_app/session/measure_light.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/small_scene.h"

namespace gs {
namespace {

Config on_the_cpu() {
  Config config;
  config.train.device = "cpu";
  return config;
}

/// The small scene, every other photo of which is darker by the factor.
Scene scene_in_light(double factor) {
  Scene scene = small_scene();
  for (std::size_t v = 0; v < scene.train_views.size(); v += 2)
    for (std::uint8_t& value : scene.train_views[v].photo.pixels)
      value = std::uint8_t(std::lround(factor * double(value)));
  return scene;
}

TEST(MeasureLight, FindsWhatPhotosDifferBy) {
  // Half of the log gains are above their mean by as much as the others are below it.
  const double expected = -std::log(0.75) / 2;
  EXPECT_NEAR(gain_spread(on_the_cpu(), scene_in_light(0.75)), expected, 0.03);
  EXPECT_LT(gain_spread(on_the_cpu(), scene_in_light(1)), 0.03);
}

TEST(MeasureLight, ChoosesGainsWherePhotosDiffer) {
  EXPECT_TRUE(choose_photometric_by_run(on_the_cpu(), scene_in_light(0.75)).has_gains);
  EXPECT_FALSE(choose_photometric_by_run(on_the_cpu(), scene_in_light(1)).has_gains);
}

TEST(MeasureLight, ChoosesNothingWithoutPoints) {
  Scene scene = scene_in_light(0.5);
  scene.points.clear();
  const PhotometricChoice choice = choose_photometric_by_run(on_the_cpu(), scene);
  EXPECT_FALSE(choice.has_gains);
  EXPECT_NE(choice.why.find("no points"), std::string::npos) << choice.why;
}

}  // namespace
}  // namespace gs
