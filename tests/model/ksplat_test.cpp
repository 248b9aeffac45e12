// SPDX-License-Identifier: Apache-2.0
// .ksplat at each of its levels, and damaged ones. interop/formats_test reads files of
// GaussianSplats3D itself.
#include "gs_model/formats/ksplat.h"

#include <gmock/gmock.h>

#include "gs_core/system/log.h"
#include "gs_model/formats/formats.h"
#include "tests/support/damage.h"
#include "tests/support/error_of.h"
#include "tests/support/ksplat_writer.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// Means within half a bucket of each other, and colors of a byte.
GaussianModel moderate_model(std::size_t count, int sh_degree) {
  GaussianModel model = random_model(count, sh_degree);
  for (std::size_t i = 0; i < count; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      float& x = model.gaussians.mean[i][axis];
      x = 40 + 0.5f * std::tanh(x);
      model.gaussians.sh0[i][axis] = 1.7f * std::tanh(model.gaussians.sh0[i][axis]);
    }
    for (Vec3f& c : model.gaussians.sh_rest[i].coefficient)
      for (int channel = 0; channel < 3; ++channel) c[channel] = std::tanh(c[channel]);
  }
  return model;
}

class Ksplat : public testing::Test {
 protected:
  static void SetUpTestSuite() { setup_log(Verbosity::quiet); }
  std::filesystem::path file() const { return folder_.path() / "model.ksplat"; }
  GaussianModel read(const std::string& bytes) const {
    replace_bytes(file(), bytes);
    return read_model(file());
  }
  std::string error_with(std::string bytes, std::size_t at, std::uint32_t value) const {
    ksplat::put(bytes, at, value);
    return error_of([&] { read(bytes); });
  }

  TempFolder folder_;
};

void expect_near(const Vec3f& a, const Vec3f& b, float tolerance) {
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(a[k], b[k], tolerance);
}

TEST_F(Ksplat, EveryLevelAndDegreeComesBack) {
  struct Level {
    float position, scale, rotation, sh;  // twice the largest rounding error
  };
  constexpr Level kLevels[] = {
      {0, 2e-6f, 1e-6f, 0}, {1e-4f, 1e-3f, 1e-3f, 1e-3f}, {1e-4f, 1e-3f, 1e-3f, 0.012f}};
  for (unsigned level = 0; level < 3; ++level)
    for (int degree = 0; degree <= 3; ++degree) {
      SCOPED_TRACE(fmt::format("level {}, degree {}", level, degree));
      const GaussianModel model = moderate_model(23, degree);
      // Sections of 9, 9 and 5 rows in buckets of 4: some of them are not full.
      const GaussianModel back = read(ksplat_bytes(model, {.level = level, .rows_per_section = 9}));
      ASSERT_EQ(back.gaussians.count(), 23u);
      EXPECT_EQ(back.sh_degree, degree);
      EXPECT_FALSE(back.is_ours);
      const Gaussians &a = back.gaussians, &b = model.gaussians;
      for (std::size_t i = 0; i < 23; ++i) {
        expect_near(a.mean[i], b.mean[i], kLevels[level].position);
        expect_near(a.log_scale[i], b.log_scale[i], kLevels[level].scale);
        expect_near(a.sh0[i], b.sh0[i], 0.015f);
        EXPECT_NEAR(sigmoid(a.logit_opacity[i]), sigmoid(b.logit_opacity[i]), 0.003f);
        const Quatf &p = a.rotation[i], &q = b.rotation[i];
        EXPECT_NEAR(p.w * q.w + p.x * q.x + p.y * q.y + p.z * q.z, 1, kLevels[level].rotation);
        for (int k = 0; k < kShRestCount; ++k)
          expect_near(a.sh_rest[i].coefficient[k], b.sh_rest[i].coefficient[k], kLevels[level].sh);
      }
    }
}

TEST_F(Ksplat, TheRangesOfTheFileCount) {
  const GaussianModel model = moderate_model(5, 1);
  const GaussianModel back = read(ksplat_bytes(
      model, {.level = 2, .range = 1000, .block = 4, .least_sh = -1, .largest_sh = 2}));
  for (std::size_t i = 0; i < 5; ++i) {
    expect_near(back.gaussians.mean[i], model.gaussians.mean[i], 0.0011f);  // half of 4 / 2000
    expect_near(back.gaussians.sh_rest[i].coefficient[1], model.gaussians.sh_rest[i].coefficient[1],
                0.006f);
  }
  std::string usual = ksplat_bytes(model, {.level = 2});
  const GaussianModel expected = read(usual);
  for (const std::size_t at : {36, 40, 4096 + 24}) ksplat::put(usual, at, std::uint32_t(0));
  EXPECT_EQ(read(usual).gaussians.sh_rest[0].coefficient[0],
            expected.gaussians.sh_rest[0].coefficient[0]);
  EXPECT_EQ(read(usual).gaussians.mean[0], expected.gaussians.mean[0]);
}

TEST_F(Ksplat, WrongFilesAreRefusedWithARemedy) {
  const std::string good = ksplat_bytes(moderate_model(6, 1), {});
  EXPECT_THAT(error_with(good, 0, 0x0201), AllOf(HasSubstr("1.2"), HasSubstr("check what it is")));
  EXPECT_THAT(error_with(good, 20, 3), AllOf(HasSubstr("level 3"), HasSubstr("export it again")));
  EXPECT_THAT(error_with(good, 4, 1'000'000), HasSubstr("more sections than its size allows"));
  EXPECT_THAT(error_with(good, 4096, 7), HasSubstr("more Gaussians than rows"));
  EXPECT_THAT(error_with(good, 4096 + 4, 0xFFFFFFFF), HasSubstr("ends too early"));
  EXPECT_THAT(error_with(good, 4096 + 12, 1), HasSubstr("a bucket"));
  EXPECT_THAT(error_with(good, 4096 + 12, 0xFFFFFFFF), HasSubstr("ends too early"));
  EXPECT_THAT(error_with(good, 4096 + 36, 0x40000000), HasSubstr("ends too early"));
  EXPECT_THAT(error_with(good, 4096 + 40, 4), HasSubstr("a degree above 3"));
  EXPECT_THAT(error_of([&] { read("text"); }),
              AllOf(HasSubstr("model.ksplat"), HasSubstr("copy or export it again")));
}

TEST_F(Ksplat, IsReadButNotWritten) {
  EXPECT_EQ(find_format("a.KSPLAT")->name, "ksplat");
  EXPECT_THAT(error_of([&] { write_model(file(), moderate_model(2, 0)); }),
              HasSubstr("gemsplat does not write .ksplat; it writes .ply"));
}

TEST_F(Ksplat, DamagedFilesAreReadOrRefused) {
  std::vector<std::string> files;
  for (unsigned level = 0; level < 3; ++level)
    files.push_back(ksplat_bytes(moderate_model(6, 1), {.level = level, .rows_per_section = 5}));
  const FuzzCases cases;
  for (unsigned number = cases.first; number < cases.first + cases.count; ++number) {
    std::mt19937 random(number);
    std::string bytes = files[number % 3];
    // Most bytes of the headers mean nothing: only those that do, and the data, are damaged.
    const std::size_t begins[] = {0, 4096, 4096 + 1024, 4096 + 2048};
    const std::size_t sizes[] = {44, 42, 42, bytes.size() - 4096 - 2048};
    const std::size_t part = random() % 4;
    bytes.replace(begins[part], sizes[part],
                  damaged(bytes.substr(begins[part], sizes[part]), random).substr(0, sizes[part]));
    EXPECT_EQ(trouble_of([&] { read(bytes); }), "") << "case " << number;
  }
}

}  // namespace
}  // namespace gs
