// SPDX-License-Identifier: Apache-2.0
// A file keeps every bit of its floats.
#include "data_loaders/photos/exr.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <limits>

#include "gs_core/error.h"
#include "tests/support/error_of.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using ::testing::ElementsAre;

class Exr : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!can_write_exr()) GTEST_SKIP() << cannot_write_exr();
  }
  std::filesystem::path file() const { return folder_.path() / "sub" / "a.exr"; }
  TempFolder folder_;
};

TEST_F(Exr, DepthComesBackToTheLastBit) {
  ImageF depth(5, 3, 1);
  for (std::size_t i = 0; i < depth.pixels.size(); ++i)
    depth.pixels[i] = std::bit_cast<float>(0x3f9d70a4u + 0x1234567u * std::uint32_t(i));
  depth.pixels[0] = 0;
  depth.pixels[1] = 1e30f;
  depth.pixels[2] = std::numeric_limits<float>::min();
  write_exr(file(), depth, {"Z"});
  std::vector<std::string> channels;
  const ImageF read = read_exr(file(), &channels);
  EXPECT_THAT(channels, ElementsAre("Z"));
  EXPECT_EQ(read.width, 5);
  EXPECT_EQ(read.height, 3);
  ASSERT_EQ(read.pixels.size(), depth.pixels.size());
  for (std::size_t i = 0; i < depth.pixels.size(); ++i)
    EXPECT_EQ(std::bit_cast<std::uint32_t>(read.pixels[i]),
              std::bit_cast<std::uint32_t>(depth.pixels[i]))
        << i;
}

TEST_F(Exr, ChannelsKeepTheirOrderAndNames) {
  for (const std::vector<std::string>& names :
       {std::vector<std::string>{"R", "G", "B"}, {"N.X", "N.Y", "N.Z"}}) {
    ImageF image(2, 1, 3);
    image.pixels = {1, -2, 3, 0.25f, -0.5f, 1000};
    write_exr(file(), image, names);
    std::vector<std::string> channels;
    EXPECT_EQ(read_exr(file(), &channels).pixels, image.pixels);
    EXPECT_EQ(channels, names);
  }
}

TEST_F(Exr, WhatIsNoPictureOfFloatsIsAnError) {
  EXPECT_THROW(read_exr(folder_.path() / "none.exr"), Error);
  write_bytes(file(), "no picture");
  EXPECT_THROW(read_exr(file()), Error);
  write_exr(file(), ImageF(64, 64, 1, 0.3f), {"Z"});
  const std::string whole = read_bytes(file());
  write_bytes(file(), whole.substr(0, whole.size() / 2));
  EXPECT_THROW(read_exr(file()), Error);
}

TEST_F(Exr, AFileWhereAFolderIsNeededIsAnErrorThatNamesIt) {
  write_bytes(folder_.path() / "sub", "a file");
  EXPECT_THAT(error_of([&] { write_exr(file(), ImageF(1, 1, 1), {"Z"}); }),
              ::testing::HasSubstr(file().string()));
}

}  // namespace
}  // namespace gs
