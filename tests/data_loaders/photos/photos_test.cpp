// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/photos.h"
#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/encode/encode_png.h"

#include <gmock/gmock.h>

#include <numeric>

#include "data_loaders/photos/cut_short.h"
#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"
#include "tests/support/foreign_leaks.h"
#include "tests/support/tiny_photos.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

template <std::size_t N>
std::string bytes_of(const unsigned char (&photo)[N]) {
  return {reinterpret_cast<const char*>(photo), N};
}

/// The photo that these bytes decode to.
Image8 decoded(const std::string& bytes, const char* name) {
  const TempFolder temp;
  write_bytes(temp.path() / name, bytes);
  return read_photo(temp.path() / name);
}

std::string error_of(const std::filesystem::path& path) {
  return gs::error_of([&] { read_photo(path); });
}

/// A picture of noise, the same on every run.
Image8 noise(int width, int height, int channels) {
  Image8 image(width, height, channels);
  std::uint32_t state = 1;
  for (std::uint8_t& value : image.pixels)
    value = std::uint8_t((state = state * 1664525u + 1013904223u) >> 24);
  return image;
}

TEST(PhotoNames, OnlyExtensionsOfPicturesAreExtensions) {
  EXPECT_EQ(without_extension("a.b/left.001.JPG"), "a.b/left.001");
  EXPECT_EQ(without_extension("left.001"), "left.001");
  EXPECT_EQ(without_extension("frame.7"), "frame.7");
  EXPECT_EQ(without_extension("IMG_1.dng"), "IMG_1");
  EXPECT_EQ(without_extension("c"), "c");
}

class Photos : public FolderTest {};

TEST_F(Photos, GrayIsRepeatedInThreeChannels) {
  const Image8 photo = decoded(bytes_of(kGrayPng), "gray.png");
  EXPECT_EQ(photo.channels, 3);
  EXPECT_THAT(photo.pixels, ElementsAre(10, 10, 10, 200, 200, 200));
}

TEST_F(Photos, AlphaIsGivenBesideTheColor) {
  const auto alpha_of = [&](const std::string& bytes) {
    write_bytes(path("photo.png"), bytes);
    return read_photo_with_alpha(path("photo.png")).alpha;
  };
  EXPECT_THAT(alpha_of(bytes_of(kRgbaPng)).pixels, ElementsAre(128, 0));
  EXPECT_THAT(alpha_of(bytes_of(kGrayAlphaPng)).pixels, ElementsAre(0, 255));
  EXPECT_EQ(alpha_of(bytes_of(kRgbaPng)).channels, 1);
  EXPECT_TRUE(alpha_of(bytes_of(kGrayPng)).empty());
  EXPECT_TRUE(alpha_of(bytes_of(kRgb16Png)).empty());
}

TEST_F(Photos, APngWithAlphaComesBackAsWritten) {
  const Image8 image = noise(31, 9, 4);
  write_png(path("photo.png"), image);
  const PhotoWithAlpha read = read_photo_with_alpha(path("photo.png"));
  for (std::size_t i = 0; i < read.alpha.pixels.size(); ++i) {
    ASSERT_EQ(read.alpha.pixels[i], image.pixels[4 * i + 3]);
    for (int c = 0; c < 3; ++c) ASSERT_EQ(read.photo.pixels[3 * i + c], image.pixels[4 * i + c]);
  }
}

TEST_F(Photos, AlphaIsDroppedAndColorStaysAsStored) {
  EXPECT_THAT(decoded(bytes_of(kRgbaPng), "rgba.png").pixels, ElementsAre(200, 100, 50, 1, 2, 3));
  EXPECT_THAT(decoded(bytes_of(kGrayAlphaPng), "ga.png").pixels,
              ElementsAre(90, 90, 90, 60, 60, 60));
}

TEST_F(Photos, SixteenBitsBecomeEight) {
  EXPECT_THAT(decoded(bytes_of(kRgb16Png), "deep.png").pixels,
              ElementsAre(0, 1, 128, 254, 255, 77));
}

TEST_F(Photos, ExifOrientationTurnsNothing) {
  write_bytes(path("turned.jpg"), bytes_of(kTurnedJpeg));
  const PhotoSize size = read_photo_size(path("turned.jpg"));
  EXPECT_EQ(size.width, 16);
  EXPECT_EQ(size.height, 8);
  const Image8 photo = read_photo(path("turned.jpg"));
  ASSERT_EQ(photo.width, 16);
  ASSERT_EQ(photo.height, 8);
  EXPECT_GT(photo.at(0, 7, 0), 150);  // red on the left
  EXPECT_LT(photo.at(0, 7, 2), 100);
  EXPECT_GT(photo.at(15, 0, 2), 150);  // blue on the right
  EXPECT_LT(photo.at(15, 0, 0), 100);
}

TEST_F(Photos, PngComesBackAsWritten) {
  const Image8 image = noise(37, 23, 3);
  write_png(folder() / "sub" / "photo.png", image);
  const PhotoSize size = read_photo_size(folder() / "sub" / "photo.png");
  EXPECT_EQ(size.width, 37);
  EXPECT_EQ(size.height, 23);
  EXPECT_EQ(read_photo(folder() / "sub" / "photo.png").pixels, image.pixels);
}

// Pictures of one strip and of several, of noise, of one value, and with long runs.
TEST_F(Photos, PngsOfAllKindsComeBackAsWritten) {
  for (const int channels : {1, 3, 4})
    for (const auto& [width, height] : {std::pair(1, 1), {2, 3}, {300, 700}})
      for (const bool has_runs : {false, true}) {
        Image8 image = noise(width, height, channels);
        for (std::uint8_t& value : image.pixels)
          if (has_runs && value > 3) value = 200;
        write_png(folder() / "photo.png", image);
        const PhotoWithAlpha read = read_photo_with_alpha(folder() / "photo.png");
        const int colors = std::min(channels, 3);
        for (std::size_t i = 0; i < read.photo.pixels.size() / 3; ++i)
          for (int c = 0; c < 3; ++c)
            ASSERT_EQ(read.photo.pixels[3 * i + std::size_t(c)],
                      image.pixels[std::size_t(channels) * i + std::size_t(c % colors)])
                << width << " " << channels << " " << has_runs;
        for (std::size_t i = 0; i < read.alpha.pixels.size(); ++i)
          ASSERT_EQ(read.alpha.pixels[i], image.pixels[4 * i + 3]);
      }
}

TEST_F(Photos, EncodedBytesDoNotDependOnTheNumberOfThreads) {
  const int threads = thread_count();
  const Image8 image = noise(1200, 900, 3);
  set_thread_count(1);
  const auto png = encode_png(image), jpeg = encode_jpeg(image, 80);
  set_thread_count(5);
  EXPECT_EQ(encode_png(image), png);
  EXPECT_EQ(encode_jpeg(image, 80), jpeg);
  set_thread_count(threads);
}

TEST_F(Photos, APictureOfOneColorTakesFewBytes) {
  EXPECT_LT(encode_png(Image8(1000, 1000, 3, 90)).size(), 10'000u);
}

// Its width and height are no multiples of a block.
TEST_F(Photos, ALargeJpegHasThePixelsOfOneMadeAtOnce) {
  Image8 image(1207, 903, 3);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = std::uint8_t(x * (c + 1) / 5 + y * y / 90);
  const auto decoded_jpeg = [&](const std::vector<std::uint8_t>& bytes) {
    return decoded({bytes.begin(), bytes.end()}, "large.jpg");
  };
  const auto strips = encode_jpeg(image, 85), alone = encode_jpeg_alone(image, 85);
  EXPECT_NE(strips, alone);
  const Image8 read = decoded_jpeg(strips);
  EXPECT_EQ(read.height, image.height);
  EXPECT_EQ(read.pixels, decoded_jpeg(alone).pixels);
}

TEST_F(Photos, GrayPngMayBeWritten) {
  write_png(path("gray.png"), Image8(2, 1, 1, 77));
  EXPECT_THAT(read_photo(path("gray.png")).pixels, ElementsAre(77, 77, 77, 77, 77, 77));
}

TEST_F(Photos, AJpegIsNearToWhatWasEncodedAndSmallerAtLowerQuality) {
  Image8 image(40, 24, 3);
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 40; ++x)
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = std::uint8_t(60 + 3 * x + 2 * y + 10 * c);
  const std::vector<std::uint8_t> bytes = encode_jpeg(image, 90);
  write_bytes(path("a.jpg"), std::string(bytes.begin(), bytes.end()));
  const Image8 back = read_photo(path("a.jpg"));
  ASSERT_EQ(back.pixels.size(), image.pixels.size());
  for (std::size_t i = 0; i < image.pixels.size(); ++i)
    ASSERT_NEAR(back.pixels[i], image.pixels[i], 8) << i;  // a smooth ramp: rounding of its blocks
  EXPECT_LT(encode_jpeg(noise(40, 24, 3), 30).size(), encode_jpeg(noise(40, 24, 3), 90).size());
}

TEST_F(Photos, WritingLeavesNoOtherFileBehind) {
  write_png(path("a.png"), noise(4, 4, 3));
  write_png(path("a.png"), noise(5, 5, 3));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder()), {}), 1);
}

TEST_F(Photos, WhatIsNoPhotoIsNamed) {
  EXPECT_THAT(error_of(path("none.jpg")), AllOf(HasSubstr("none.jpg"), HasSubstr("no such file")));
  EXPECT_THAT(error_of(folder()), HasSubstr("this is a folder"));
  write_bytes(path("text.jpg"), "this is no photo");
  EXPECT_THAT(error_of(path("text.jpg")), HasSubstr("cannot read photo"));
  write_bytes(path("empty.jpg"), "");
  EXPECT_THAT(error_of(path("empty.jpg")), HasSubstr("cannot read photo"));
}

TEST_F(Photos, TruncationAtEveryByteOfAJpegIsAnErrorNotAGrayPhoto) {
  const std::string whole = bytes_of(kTurnedJpeg);
  for (std::size_t size = 0; size < whole.size(); ++size) {
    write_bytes(path("cut.jpg"), whole.substr(0, size));
    ASSERT_THAT(error_of(path("cut.jpg")), HasSubstr("cut.jpg")) << size;
  }
}

TEST_F(Photos, AFileThatIsCutShortIsToldFromAWholeOne) {
  const std::vector<std::uint8_t> encoded = encode_jpeg(noise(24, 16, 3), 90);
  const std::string jpeg(encoded.begin(), encoded.end());
  write_png(path("whole.png"), noise(24, 16, 3));
  const std::string png = read_bytes(path("whole.png"));
  const std::string heic(reinterpret_cast<const char*>(kHeic), sizeof kHeic);
  const std::string webp = std::string("RIFF\x0a\0\0\0WEBP", 12) + "VP8L__";
  const auto is_cut = [&](const std::string& bytes) {
    write_bytes(path("photo"), bytes);
    return is_cut_short(path("photo"));
  };
  for (const std::string& whole : {jpeg, png, heic, webp}) {
    EXPECT_FALSE(is_cut(whole));
    for (std::size_t size = 13; size < whole.size() - 2; size += 7)
      EXPECT_TRUE(is_cut(whole.substr(0, size))) << size << " of " << whole.size();
  }
  EXPECT_FALSE(is_cut(jpeg + "what a phone writes behind it"));
  EXPECT_FALSE(is_cut(jpeg + std::string(2 << 20, 'x')));
  EXPECT_TRUE(is_cut(jpeg.substr(0, jpeg.size() - 2) + std::string(2 << 20, 'x')));
  EXPECT_TRUE(is_cut(""));
  EXPECT_FALSE(is_cut("some other format"));
}

TEST_F(Photos, TruncatedPngIsAnError) {
  // OpenImageIO 2.4's PNG reader jumps out of libpng past a string
  const IgnoreForeignLeaks ignore;
  write_png(path("whole.png"), noise(64, 64, 3));
  const std::string whole = read_bytes(path("whole.png"));
  for (std::size_t size = 0; size + 64 < whole.size(); size += 97) {
    write_bytes(path("cut.png"), whole.substr(0, size));
    ASSERT_THAT(error_of(path("cut.png")), HasSubstr("cut.png")) << size;
  }
}

TEST(AreaResized, EveryPixelIsTheMeanOfWhatItCovers) {
  Image8 image(3, 2, 1);
  image.pixels = {0,  30, 90,  //
                  60, 90, 30};
  // Columns of 1.5: (2 * first + 1 * second) / 3 and (1 * second + 2 * third) / 3.
  EXPECT_THAT(area_resized(image, 2, 2).pixels, ElementsAre(10, 70, 70, 50));
  EXPECT_THAT(area_resized(image, 3, 1).pixels, ElementsAre(30, 60, 60));
  EXPECT_THAT(area_resized(image, 1, 1).pixels, ElementsAre(50));
}

TEST(AreaResized, HalvesAreRoundedUp) {
  Image8 image(2, 1, 1);
  image.pixels = {0, 1};
  EXPECT_THAT(area_resized(image, 1, 1).pixels, ElementsAre(1));
  image.pixels = {3, 4};
  EXPECT_THAT(area_resized(image, 1, 1).pixels, ElementsAre(4));
}

TEST(AreaResized, KeepsTheMeanAtAnySize) {
  const Image8 image = noise(101, 67, 3);
  const auto mean = [](const Image8& i) {
    return std::accumulate(i.pixels.begin(), i.pixels.end(), 0.0) / double(i.pixels.size());
  };
  for (const auto& [width, height] :
       {std::pair(50, 33), std::pair(13, 66), std::pair(101, 5), std::pair(1, 1)})
    // Rounding moves a pixel by at most 0.5, and 3 channels of 1 x 1 are averaged over 3 such
    // errors.
    EXPECT_NEAR(mean(area_resized(image, width, height)), mean(image), 0.5);
}

TEST(AreaResized, SameSizeChangesNothingAndThreadsDoNotMatter) {
  const Image8 image = noise(97, 83, 3);
  EXPECT_EQ(area_resized(image, 97, 83).pixels, image.pixels);
  set_thread_count(1);
  const Image8 alone = area_resized(image, 31, 40);
  set_thread_count(3);
  const Image8 together = area_resized(image, 31, 40);
  set_thread_count(0);
  EXPECT_EQ(alone.pixels, together.pixels);
}

}  // namespace
}  // namespace gs
