// SPDX-License-Identifier: Apache-2.0
// extreme_saving.zip of LightGaussian: which Gaussians keep their colors, and which files are refused.
// tests/python/npz_test.py compares with NumPy, formats_test.cpp all numbers.
#include "gs_model/formats/npz/vectree.h"

#include <gmock/gmock.h>

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

class Vectree : public ZlibTest {
 protected:
  std::filesystem::path file(const std::string& name = "extreme_saving.zip") const {
    return folder_.path() / name;
  }
  /// The archive's files, each changed by `change`, which may empty one to leave it out.
  template <class Change>
  void repack(Change&& change) const {
    const std::string archive = read_bytes(file());
    std::vector<ZipEntry> entries;
    for (const auto& [name, packed] : packed_entries(file(), archive)) {
      ZipEntry entry{name, unpacked(file(), name, packed)};
      change(entry);
      if (!entry.bytes.empty()) entries.push_back(entry);
    }
    write_bytes(file(), zip_of(entries, true));
  }
  static std::string npz_of(const NpyArray& array) {
    return zip_of({{"arr_0.npy", npy_bytes(array)}}, true);
  }
  std::string refusal() const {
    return error_of([&] { read_model(file()); });
  }

  TempFolder folder_;
};

// 20,000 of 33,333 colors share 8,192.
TEST_F(Vectree, TheMostImportantKeepTheirColors) {
  const GaussianModel model = random_model(33'333, 1);
  RowImportance importance{std::vector<float>(33'333), {}};
  for (std::size_t i = 0; i < 33'333; ++i) importance.color[i] = float(i % 1000);
  write_model(file("a.extreme_saving.zip"), model, {.importance = importance});
  const GaussianModel back = read_model(file("a.extreme_saving.zip"));
  ASSERT_EQ(back.gaussians.count(), 33'333u);
  EXPECT_EQ(back.sh_degree, 1);
  double own = 0, shared = 0;
  for (std::size_t i = 0; i < 33'333; ++i) {
    const Vec3f d = back.gaussians.sh0[i] - model.gaussians.sh0[i];
    const float error = std::abs(d.x) + std::abs(d.y) + std::abs(d.z);
    if (i % 1000 > 600) own = std::max(own, double(error));
    if (i % 1000 < 600) shared += error / 20'000;
  }
  EXPECT_LT(own, 0.01);
  EXPECT_GT(shared, 0.1);
  EXPECT_LT(shared, 1.5);  // 2.4 if all had the mean
}

TEST_F(Vectree, AFolderBeforeTheNamesIsPassedOver) {
  const GaussianModel model = random_model(20, 2);
  write_model(file("a.extreme_saving.zip"), model);
  std::filesystem::rename(file("a.extreme_saving.zip"), file());
  repack([](ZipEntry& entry) { entry.name = "tmp/a b/" + entry.name; });
  EXPECT_EQ(read_model(file()).gaussians.mean[19], model.gaussians.mean[19]);
}

TEST_F(Vectree, DamagedArchivesAreRefused) {
  const auto write = [&] {
    write_model(file("a.extreme_saving.zip"), random_model(20, 2));
    std::filesystem::rename(file("a.extreme_saving.zip"), file());
  };
  const auto with = [&](const std::string& name, const std::string& bytes) {
    write();
    repack([&](ZipEntry& entry) {
      if (entry.name == "extreme_saving/" + name + ".npz") entry.bytes = bytes;
    });
    return refusal();
  };
  EXPECT_THAT(with("codebook", ""), AllOf(HasSubstr("lacks codebook.npz"), HasSubstr("export it")));
  EXPECT_THAT(with("codebook", npz_of({"f2", {2, 5}, std::string(20, 0)})),
              HasSubstr("colors that fit no SH degree"));
  EXPECT_THAT(with("codebook", npz_of({"f2", {0, 27}, ""})), HasSubstr("fit no SH degree"));
  EXPECT_THAT(with("xyz", npz_of({"f4", {60}, std::string(240, 0)})),
              HasSubstr("three numbers in each row"));
  EXPECT_THAT(with("other_attribute", npz_of({"f2", {19, 8}, std::string(304, 0)})),
              HasSubstr("has no 160 numbers in other_attribute"));
  EXPECT_THAT(with("non_vq_mask", npz_of({"u1", {2}, "\x01\x02"})), HasSubstr("has no 20 bits"));
  EXPECT_THAT(with("vq_indexs", npz_of({"u1", {1}, "\x01"})), HasSubstr("bits in vq_indexs"));
  EXPECT_THAT(with("vq_indexs", zip_of({{"b.npy", "x"}})), HasSubstr("lacks arr_0 in vq_indexs"));
  EXPECT_THAT(with("non_vq_feats", npz_of({"f2", {900, 27}, std::string(900 * 54, 0)})),
              HasSubstr("too many numbers in non_vq_feats"));
}

}  // namespace
}  // namespace gs
