// SPDX-License-Identifier: Apache-2.0
// .npz of c3dgs: what codebooks keep, what has an entry of its own, and which files are refused.
// tests/python/npz_test.py compares with NumPy.
#include "gs_model/formats/npz/npz.h"

#include <gmock/gmock.h>

#include <cmath>

#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/npz/npy_array.h"
#include "tests/support/error_of.h"
#include "tests/support/models.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test.h"
#include "tests/support/zlib_test.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

Sym3<double> world_covariance(const Gaussians& g, std::size_t i) {
  return covariance(rotation_matrix(in_double(g.rotation[i])), variance(Vec3d(g.log_scale[i])));
}
double trace(const Sym3<double>& s) { return s.xx + s.yy + s.zz; }
float largest_of(const Vec3f& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

class Npz : public ZlibTest {
 protected:
  std::filesystem::path file() const { return folder_.path() / "model.npz"; }
  GaussianModel there_and_back(const GaussianModel& model, const RowImportance& importance = {}) {
    write_model(file(), model, {.importance = importance});
    return read_model(file());
  }
  /// The row of `model` with the mean nearest to that of row i of `back`.
  static std::size_t original_of(const GaussianModel& back, std::size_t i,
                                 const GaussianModel& model) {
    const auto distance = [&](std::size_t j) {
      return largest_of(back.gaussians.mean[i] - model.gaussians.mean[j]);
    };
    std::size_t nearest = 0;
    for (std::size_t j = 1; j < model.gaussians.count(); ++j)
      if (distance(j) < distance(nearest)) nearest = j;
    return nearest;
  }
  static float color_error(const GaussianModel& a, std::size_t i, const GaussianModel& b,
                           std::size_t j) {
    float error = largest_of(a.gaussians.sh0[i] - b.gaussians.sh0[j]);
    for (int k = 0; k < kShRestCount; ++k)
      error = std::max(error, largest_of(a.gaussians.sh_rest[i].coefficient[k] -
                                         b.gaussians.sh_rest[j].coefficient[k]));
    return error;
  }
  NpyArray array(const std::string& name) const {
    const std::string bytes = read_bytes(file());
    const auto entries = packed_entries(file(), bytes);
    return npy_array(file(), name, unpacked(file(), name, entries.at(name + ".npy")));
  }
  /// The file with an array replaced by these bytes, or left out where they are empty.
  void replace(const std::string& name, const std::string& bytes) const {
    const std::string archive = read_bytes(file());
    std::vector<ZipEntry> entries;
    for (const auto& [entry, packed] : packed_entries(file(), archive))
      if (entry != name + ".npy")
        entries.push_back({entry, unpacked(file(), entry, packed)});
      else if (!bytes.empty())
        entries.push_back({entry, bytes});
    write_bytes(file(), zip_of(entries, true));
  }

  TempFolder folder_;
};

// Numbers of random_model() lie within 4.5, so that a byte has steps of 0.035.
TEST_F(Npz, AModelOfFewGaussiansLosesRoundingsAtEveryDegree) {
  for (int degree = 0; degree <= kMaxShDegree; ++degree) {
    const GaussianModel model = random_model(600, degree), back = there_and_back(model);
    ASSERT_EQ(back.gaussians.count(), 600u);
    EXPECT_EQ(back.sh_degree, degree);
    for (std::size_t i = 0; i < 600; ++i) {
      const std::size_t j = original_of(back, i, model);
      EXPECT_LE(largest_of(back.gaussians.mean[i] - model.gaussians.mean[j]), 0.002f) << i;
      EXPECT_NEAR(sigmoid(back.gaussians.logit_opacity[i]),
                  sigmoid(model.gaussians.logit_opacity[j]), 0.0021f)
          << i;
      EXPECT_LE(color_error(back, i, model, j), 0.02f) << i;
      const Sym3<double> a = world_covariance(back.gaussians, i),
                         b = world_covariance(model.gaussians, j);
      EXPECT_NEAR(std::log(trace(a)), std::log(trace(b)), 0.035) << i;
      const double pairs[][2] = {{a.xx, b.xx}, {a.xy, b.xy}, {a.xz, b.xz},
                                 {a.yy, b.yy}, {a.yz, b.yz}, {a.zz, b.zz}};
      for (const auto& [found, expected] : pairs)
        EXPECT_NEAR(found / trace(a), expected / trace(b), 0.025) << i;
    }
  }
}

TEST_F(Npz, GaussiansOfFewKindsShareCodebooksOf4096) {
  GaussianModel model = random_model(12'000, 1);
  for (std::size_t i = 0; i < model.gaussians.count(); ++i) {
    model.gaussians.sh0[i] = model.gaussians.sh0[i % 20];
    model.gaussians.sh_rest[i] = model.gaussians.sh_rest[i % 20];
  }
  const GaussianModel back = there_and_back(model);
  EXPECT_LE(array("features_rest").shape[0], 4096u + 12'000 / 16);
  EXPECT_LE(array("rotation").shape[0], 4096u + 12'000 / 2);
  for (std::size_t i = 0; i < back.gaussians.count(); ++i) {
    float least = 1;
    for (std::size_t kind = 0; kind < 20; ++kind)
      least = std::min(least, color_error(back, i, model, kind));
    EXPECT_LE(least, 0.02f) << i;
  }
}

TEST_F(Npz, GaussiansOfHighImportanceKeepTheirOwnEntries) {
  const GaussianModel model = random_model(6000, 3);
  RowImportance importance{std::vector<float>(6000, 1e-7f), std::vector<float>(6000, 0.0f)};
  for (std::size_t i = 0; i < 6000; i += 30) importance.color[i] = importance.shape[i] = 1e-5f;
  const GaussianModel back = there_and_back(model, importance);
  EXPECT_EQ(array("features_dc").shape[0], 4096u + 200);
  EXPECT_EQ(array("scaling").shape[0], 4096u + 200);
  float largest_own = 0, largest_shared = 0;
  for (std::size_t i = 0; i < 6000; i += 7) {
    const std::size_t j = original_of(back, i, model);
    float& largest_error = j % 30 == 0 ? largest_own : largest_shared;
    largest_error = std::max(largest_error, color_error(back, i, model, j));
  }
  EXPECT_LE(largest_own, 0.025f);
  EXPECT_GE(largest_shared, 0.5f);  // random SH have no kinds
}

TEST_F(Npz, AnyNumberOfThreadsGivesTheSameBytes) {
  const GaussianModel model = random_model(6000, 3);
  const auto bytes = [&] {
    MemorySink sink("model");
    write_npz(sink, model);
    return sink.text;
  };
  EXPECT_TRUE(with_threads(1, bytes) == with_threads(3, bytes));
}

TEST_F(Npz, FarGaussiansAreRefusedWithAdvice) {
  GaussianModel model = random_model(3, 0);
  model.gaussians.mean[1].y = 7e4f;
  EXPECT_THAT(error_of([&] { there_and_back(model); }),
              AllOf(HasSubstr("7e+04 world units"), HasSubstr("--recenter")));
}

TEST_F(Npz, ArraysThatAreMissingOrDoNotFitAreNamed) {
  const auto error_with = [&](const std::string& name, const std::string& bytes) {
    write_model(file(), random_model(50, 1));
    replace(name, bytes);
    return error_of([&] { read_model(file()); });
  };
  EXPECT_THAT(error_with("xyz", ""), HasSubstr("lacks the array xyz"));
  EXPECT_THAT(error_with("rotation", ""), HasSubstr("lacks the array rotation"));
  EXPECT_THAT(error_with("opacity", npy_bytes({"i1", {49, 1}, std::string(49, '\1')})),
              HasSubstr("has no 1 numbers for each Gaussian in opacity"));
  EXPECT_THAT(error_with("features_rest", npy_bytes({"i1", {50, 4, 3}, std::string(600, '\1')})),
              HasSubstr("fit no SH degree"));
  EXPECT_THAT(error_with("feature_indices", npy_bytes({"i1", {50}, std::string(50, '\x32')})),
              HasSubstr("beyond its codebook"));
  EXPECT_THAT(error_with("opacity", std::string(1 << 20, '\0')), HasSubstr("too many numbers"));
  EXPECT_THAT(error_with("opacity", "no array"), HasSubstr("array opacity in it has no header"));
  std::string columns_first = npy_bytes({"i1", {50, 1}, std::string(50, '\1')});
  columns_first.replace(columns_first.find("False"), 5, "True ");
  EXPECT_THAT(error_with("opacity", columns_first), HasSubstr("columns before rows"));
}

TEST_F(Npz, ArraysOfOneNumberAndOfNoneHaveShapesOfNumPy) {
  for (const NpyArray& array : {NpyArray{"f4", {}, "abcd"}, NpyArray{"i1", {3}, "abc"},
                                NpyArray{"i1", {4, 0, 3}, ""}, NpyArray{"b1", {1}, "\1"}}) {
    const std::string bytes = npy_bytes(array);
    EXPECT_EQ((bytes.size() - array.bytes.size()) % 64, 0u);
    const NpyArray back = npy_array("a", "a", bytes);
    EXPECT_EQ(back.shape, array.shape);
    EXPECT_EQ(back.bytes, array.bytes);
  }
}

}  // namespace
}  // namespace gs
