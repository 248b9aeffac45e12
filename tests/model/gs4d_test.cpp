// SPDX-License-Identifier: Apache-2.0
// .gs4d: the moments that come back from a file, its chunks in the order of time, and files that
// are refused. tests/interop/gs4d_test.py reads the same files by the words of the documentation.
#include "gs_model/formats/gs4d/gs4d.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/gs4d/gs4d_layout.h"
#include "gs_model/formats/gs4d/moving_gaussian.h"
#include "tests/support/damage.h"
#include "tests/support/error_of.h"
#include "tests/support/random_model.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using testing::HasSubstr;

SpacetimeShape<double> random_shape(const Random& random, std::uint64_t i) {
  const auto l = random.normal4(i, 0), r = random.normal4(i, 1), s = random.normal4(i, 2);
  return {{1, 2, 3}, {s.x, s.y, s.z}, {{l.x, l.y, l.z, l.w}, {r.x, r.y, r.z, r.w}}, 0,
          0.4,       double(s.w) - 1};
}

TEST(MovingGaussian, HasTheCovarianceIn4DThatItWasMadeFrom) {
  const Random random{3, RandomStream::test};
  for (int i = 0; i < 500; ++i) {
    const SpacetimeShape<double> shape = random_shape(random, std::uint64_t(i));
    const SpacetimeCovariance<double> S = covariance(shape),
                                      again = covariance(shape_of(moving_gaussian(shape)));
    const double size = S.space.xx + S.space.yy + S.space.zz + S.time;
    for (const auto& [a, b] : {std::pair{S.space.xx, again.space.xx},
                               {S.space.xy, again.space.xy},
                               {S.space.xz, again.space.xz},
                               {S.space.yy, again.space.yy},
                               {S.space.yz, again.space.yz},
                               {S.space.zz, again.space.zz},
                               {S.mixed.x, again.mixed.x},
                               {S.mixed.y, again.mixed.y},
                               {S.mixed.z, again.mixed.z},
                               {S.time, again.time}})
      EXPECT_NEAR(a, b, 1e-10 * size);
  }
}

class Gs4d : public testing::Test {
 protected:
  std::filesystem::path file(const std::string& name) const { return folder_.path() / name; }
  std::string bytes_of(const GaussianModel& model) const {
    write_model(file("a.gs4d"), model);
    return read_bytes(file("a.gs4d"));
  }
  std::string error_reading(const std::string& bytes) const {
    replace_bytes(file("b.gs4d"), bytes);
    return error_of([&] { read_model(file("b.gs4d")); });
  }

 private:
  TempFolder folder_;
};

TEST_F(Gs4d, WritesTheSameBytesAgain) {
  const GaussianModel model = random_moving_model(700, 2);
  EXPECT_EQ(bytes_of(model), bytes_of(model));
}

TEST_F(Gs4d, HoldsNoGaussiansToo) {
  EXPECT_EQ(bytes_of(random_moving_model(0, 1)).size(), sizeof(Gs4dHeader));
  EXPECT_EQ(read_model(file("a.gs4d")).gaussians.count(), 0u);
}

TEST_F(Gs4d, HasWhatIsSeenFirstInTheFirstChunk) {
  const std::size_t count = kGs4dChunk + 1000;
  GaussianModel model = random_moving_model(count, 0);
  for (std::size_t i = 0; i < count;
       ++i) {  // only turns of space: nothing of them reaches into time
    model.gaussians.rotation[i] = model.gaussians.right_rotation[i] = {1, 0, 0, 0};
    model.gaussians.log_time_scale[i] = -6;
    model.gaussians.time_mean[i] = i < 1000 ? 0.8f : 0.3f;  // the late ones come first in memory
  }
  model.gaussians.time_mean[5] = 7;  // never seen
  const std::string bytes = bytes_of(model);
  ASSERT_EQ(load_little<Gs4dHeader>(bytes.data()).chunks, 2u);
  const auto chunk = [&](std::size_t c) {
    return load_little<Gs4dChunk>(bytes.data() + sizeof(Gs4dHeader) + c * sizeof(Gs4dChunk));
  };
  const float reach = 2.4477f * std::exp(-6.0f);
  EXPECT_EQ(chunk(0).count, kGs4dChunk);
  EXPECT_NEAR(chunk(0).begin, 0.3f - reach, 1e-4f);
  EXPECT_NEAR(chunk(0).end, 0.3f + reach, 1e-4f);
  EXPECT_EQ(chunk(1).count, 1000u);
  EXPECT_NEAR(chunk(1).begin, 0.8f - reach, 1e-3f);
  EXPECT_NEAR(chunk(1).end, 0.8f + reach, 1e-3f);
}

TEST_F(Gs4d, DoesNotDrawADegenerateGaussian) {
  GaussianModel model = random_moving_model(3, 0);
  model.gaussians.rotation[1] = {0, 0, 0, 0};
  MemorySink sink("a.gs4d");
  write_gs4d(sink, model, 0);
  write_bytes(file("a.gs4d"), sink.text);
  int faint = 0;
  for (const float logit : read_model(file("a.gs4d")).gaussians.logit_opacity)
    faint += sigmoid(logit) < kMinAlpha;
  EXPECT_EQ(faint, 1);
}

TEST_F(Gs4d, HoldsExtremeNumbers) {
  GaussianModel model = random_moving_model(4, 1);
  model.gaussians.mean[0] = {1e38f, -1e38f, 0};
  model.gaussians.log_scale[1] = {-3e38f, 3e38f, 80};
  model.gaussians.log_time_scale[2] = 1e30f;
  model.gaussians.time_mean[3] = -3e38f;
  model.gaussians.sh_rest[3].coefficient[0].x = 3e38f;
  bytes_of(model);
  EXPECT_EQ(read_model(file("a.gs4d")).gaussians.count(), 4u);
}

TEST_F(Gs4d, IsForModelsWithTime) {
  EXPECT_THAT(error_of([&] { write_model(file("still.gs4d"), random_model(3, 1)); }),
              HasSubstr("choose .spz or .sog"));
  EXPECT_FALSE(std::filesystem::exists(file("still.gs4d")));
  EXPECT_THAT(error_of([&] { write_model(file("a.spz"), random_moving_model(3, 1)); }),
              HasSubstr("but .ply and .gs4d do"));
}

TEST_F(Gs4d, RefusesDamagedFiles) {
  const std::string bytes = bytes_of(random_moving_model(300, 1));
  const auto with = [&](std::size_t at, const auto& value) {
    std::string changed = bytes;
    std::memcpy(changed.data() + at, &value, sizeof value);
    return changed;
  };
  const std::size_t table = sizeof(Gs4dHeader), blocks = table + sizeof(Gs4dChunk);
  EXPECT_THAT(error_reading("GS4"), HasSubstr("does not begin with \"GS4D\""));
  EXPECT_THAT(error_reading(with(0, 'X')), HasSubstr("does not begin with \"GS4D\""));
  EXPECT_THAT(error_reading(with(4, 3u)), HasSubstr("version 3, but gemsplat reads version 1"));
  EXPECT_THAT(error_reading(with(4, 2u)), HasSubstr("colors that change in time"));
  EXPECT_THAT(error_reading(with(8, 4000000000u)), HasSubstr("promises 4000000000 Gaussians"));
  EXPECT_THAT(error_reading(with(12, 4000000000u)), HasSubstr("promises 4000000000 chunks"));
  EXPECT_THAT(error_reading(with(16, std::uint8_t(4))), HasSubstr("SH degree is 4"));
  EXPECT_THAT(error_reading(with(table, 40000u)), HasSubstr("promises 40000 Gaussians"));
  EXPECT_THAT(error_reading(with(table + 4, 7u)), HasSubstr("in 7 bytes"));
  EXPECT_THAT(error_reading(with(blocks, std::nanf(""))), HasSubstr("a range"));
  EXPECT_THAT(error_reading(with(blocks + 4, 1e30f)), HasSubstr("a range"));
  EXPECT_THAT(error_reading(bytes.substr(0, bytes.size() - 1)), HasSubstr("follow the table"));
  EXPECT_THAT(error_reading(bytes + "x"), HasSubstr("follow the table"));
}

}  // namespace
}  // namespace gs
