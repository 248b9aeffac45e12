// SPDX-License-Identifier: Apache-2.0
// .rad: numbers in each encoding, a tree whose first Gaussians stand for all, and files that are
// refused. formats_test.cpp and formats_fuzz_test.cpp test it as one of all formats.
#include "gs_model/formats/lod/rad.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "gs_core/system/text/json.h"
#include "gs_model/edit/merge_gaussians.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/half.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/lod/rad_layout.h"
#include "gs_model/formats/lod/rad_values.h"
#include "gs_model/lod/splat_tree.h"
#include "tests/support/error_of.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"
#include "tests/support/zlib_test.h"

namespace gs {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(RadValues, EveryNumberOf16BitsComesBack) {
  for (std::uint32_t half = 0; half < 65536; ++half) {
    if ((half >> 10 & 31) == 31) continue;  // infinity and NaN
    EXPECT_EQ(to_half(from_half(std::uint16_t(half))), half);
  }
}

TEST(RadValues, NumbersOf16BitsAreTheNearest) {
  EXPECT_EQ(from_half(to_half(1 + 0.4f / 1024)), 1);
  EXPECT_EQ(from_half(to_half(1 + 0.6f / 1024)), 1 + 1.0f / 1024);
  EXPECT_EQ(from_half(to_half(-1e9f)), -65504);
  EXPECT_EQ(from_half(to_half(3e-8f)), 0x1p-24f);
  EXPECT_TRUE(std::isnan(from_half(0x7e00)));
  EXPECT_TRUE(std::isinf(from_half(0xfc00)));
}

// Two Gaussians of two numbers each; bytes as docs/formats/rad.md has them.
std::vector<float> two_by_two(const char* encoding, std::string bytes, float min = 0,
                              float max = 0) {
  EXPECT_EQ(bytes.size(), 4 * bytes_of_encoding(encoding));
  return decoded(encoding, bytes, 2, 2, min, max);
}

TEST(RadValues, AllEncodingsAreRead) {
  using namespace std::string_literals;
  // The bytes have number 0 of both Gaussians first, and values have Gaussian 0 first.
  EXPECT_THAT(two_by_two("f16", "\0\x3c\0\x40\0\xbc\0\0"s), ElementsAre(1, -1, 2, 0));
  EXPECT_THAT(two_by_two("f16_lebytes", "\0\0\0\0\x3c\x40\xbc\0"s), ElementsAre(1, -1, 2, 0));
  EXPECT_THAT(two_by_two("f32", "\0\0\x80\x3f\0\0\0\x40\0\0\x80\xbf\0\0\0\0"s),
              ElementsAre(1, -1, 2, 0));
  EXPECT_THAT(two_by_two("f32_lebytes", f32_lebytes({1, -1, 2, 0}, 2)), ElementsAre(1, -1, 2, 0));
  EXPECT_THAT(two_by_two("r8", "\0\xff\x33\0"s, -1, 4), ElementsAre(-1, 0, 4, -1));
  EXPECT_THAT(two_by_two("r8_delta", "\x01\xfe\x33\xcd"s, -1, 4),
              ElementsAre(testing::FloatEq(-1 + 5.0f / 255), 0, 4, -1));
  EXPECT_THAT(two_by_two("s8", "\x7f\x81\0\x7f"s, 0, 2), ElementsAre(2, 0, -2, 2));
  EXPECT_THAT(two_by_two("s8_delta", "\x7f\x02\0\x7f"s, 0, 2), ElementsAre(2, 0, -2, 2));
  EXPECT_THAT(two_by_two("ln_f16", "\0\0\0\x3c\0\0\0\0"s), ElementsAre(1, 1, std::exp(1.0f), 1));
  EXPECT_THAT(two_by_two("ln_0r8", "\0\x01\xff\x80"s, -2, 2),
              ElementsAre(0, std::exp(2.0f), std::exp(-2.0f), 1));
  EXPECT_EQ(bytes_of_encoding("f64"), 0u);
}

class Rad : public ZlibTest {
 protected:
  void SetUp() override {
    ZlibTest::SetUp();
    if (IsSkipped()) return;
    model_ = finite_model(random_model(3000, 1));
    for (float& o : model_.gaussians.logit_opacity) o -= 4;
    write_model(file(), model_);
    bytes_ = read_bytes(file());
  }
  std::filesystem::path file() const { return folder_.path() / "a.rad"; }
  Json head() const {
    return Json::parse(bytes_.substr(8, load_little<std::uint32_t>(&bytes_[4])));
  }
  /// What reading says of the file with a changed header.
  std::string error_with(const Json& head) const {
    const std::string text = head.dump();
    std::string changed = bytes_.substr(0, 4);
    append_little(changed, std::uint32_t(text.size()));
    changed += text + std::string(rad_padding(text.size()), '\0');
    const std::size_t before = load_little<std::uint32_t>(&bytes_[4]);
    write_bytes(file(), changed + bytes_.substr(8 + before + rad_padding(before)));
    return error_of([&] { read_rad(file()); });
  }

  TempFolder folder_;
  GaussianModel model_;
  std::string bytes_;
};

TEST_F(Rad, ThePrefixOfATreeHasTheMassOfTheModel) {
  const SplatTree tree = splat_tree_of(build_lod_tree(copy_of(model_.gaussians)));
  const auto mass = [&](std::size_t i) { return merge_shape_of(tree.gaussians, i).mass(); };
  double all = 0;
  for (std::size_t i = 0; i < tree.child_count.size(); ++i)
    if (tree.child_count[i] == 0) all += mass(i);
  // Those of the first 500 whose children lie behind them.
  double prefix = 0;
  for (std::size_t i = 0; i < 500; ++i)
    if (tree.child_count[i] == 0 || tree.child_start[i] + tree.child_count[i] > 500)
      prefix += mass(i);
  EXPECT_NEAR(prefix / all, 1, 0.02);  // a family at the end of the prefix counts twice
}

TEST_F(Rad, NothingOfTheTreeIsReadButTheModel) {
  EXPECT_GT(head()["count"], 3000);
  EXPECT_EQ(read_rad(file()).gaussians.count(), 3000u);
  EXPECT_EQ(head()["chunks"].size(), 1u);
}

/// The numbers of all Gaussians of a file, and of the children of each.
struct Numbers {
  std::vector<std::uint64_t> own, child_start, child_count;
};

Numbers numbers_of(const std::string& bytes) {
  const auto json_at = [&](std::size_t at, std::size_t& end) {
    const std::size_t size = load_little<std::uint32_t>(&bytes[at + 4]);
    end = at + 8 + size + rad_padding(size);
    return Json::parse(bytes.substr(at + 8, size));
  };
  Numbers numbers;
  std::size_t begin = 0, payload = 0;
  const Json head = json_at(0, begin);
  for (const Json& range : head["chunks"]) {
    const Json chunk = json_at(begin + range["offset"].get<std::size_t>(), payload);
    const std::size_t count = chunk["count"];
    for (std::size_t i = 0; i < count; ++i)
      numbers.own.push_back(chunk["base"].get<std::size_t>() + i);
    for (const Json& property : chunk["properties"]) {
      const bool is_count = property["property"] == "child_count";
      if (!is_count && property["property"] != "child_start") continue;
      const std::string raw =
          inflate_raw("a.rad",
                      std::string_view(bytes).substr(
                          payload + 8 + property["offset"].get<std::size_t>(), property["bytes"]),
                      count * (is_count ? 2 : 4));
      for (std::size_t i = 0; i < count; ++i)
        if (is_count)
          numbers.child_count.push_back(load_little<std::uint16_t>(&raw[2 * i]));
        else
          numbers.child_start.push_back(load_little<std::uint32_t>(&raw[4 * i]));
    }
  }
  return numbers;
}

// 64,000 Gaussians make a tree of more than a chunk.
TEST_F(Rad, TheFirstOfSeveralChunksIsShortAndEveryChildHasOneParent) {
  const GaussianModel large = finite_model(random_model(64'000, 0));
  write_model(file(), large);
  bytes_ = read_bytes(file());
  const Json chunks = head()["chunks"];
  ASSERT_GT(chunks.size(), 1u);
  EXPECT_LT(chunks[0]["bytes"].get<double>(), 0.03 * head()["allChunkBytes"].get<double>());
  const Numbers numbers = numbers_of(bytes_);
  EXPECT_EQ(numbers.own.back() + 1, head()["count"]);
  EXPECT_TRUE(std::count(numbers.own.begin(), numbers.own.end(), kRadChunk));
  std::vector<std::uint64_t> children = {0};
  for (std::size_t i = 0; i < numbers.own.size(); ++i)
    for (std::uint64_t c = 0; c < numbers.child_count[i]; ++c)
      children.push_back(numbers.child_start[i] + c);
  std::sort(children.begin(), children.end());
  EXPECT_EQ(children, numbers.own);
  EXPECT_EQ(read_rad(file()).gaussians.count(), 64'000u);
}

TEST_F(Rad, OtherFilesAreRefusedWithARemedy) {
  const auto error_at = [&](const char* key, const Json& value) {
    Json changed = head();
    changed[key] = value;
    return error_with(changed);
  };
  EXPECT_THAT(error_at("version", 2), HasSubstr("export it as version 1"));
  EXPECT_THAT(error_at("maxSh", 4), HasSubstr("SH degree above 3"));
  EXPECT_THAT(error_at("chunkSize", 100), HasSubstr("another number of chunks"));
  EXPECT_THAT(error_at("count", 4'000'000'000u), HasSubstr("it promises 4000000000 Gaussians"));
  EXPECT_THAT(error_at("count", 60'000), HasSubstr("a chunk of another size"));
  EXPECT_THAT(error_at("count", 17), HasSubstr("a chunk of another size"));
  Json elsewhere = head();
  elsewhere["chunks"][0]["filename"] = "a-0.radc";
  EXPECT_THAT(error_with(elsewhere), HasSubstr("export it as one file"));
  Json beyond = head();
  beyond["chunks"][0]["offset"] = 1u << 30;
  EXPECT_THAT(error_with(beyond), HasSubstr("ends too early"));
  write_bytes(file(), bytes_.substr(0, bytes_.size() / 2));
  EXPECT_THAT(error_of([&] { read_rad(file()); }), HasSubstr("copy or export the file again"));
}

}  // namespace
}  // namespace gs
