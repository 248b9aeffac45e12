// SPDX-License-Identifier: Apache-2.0
// The EXIF orientation of photos: read, followed, and left behind in copies.
#include "data_loaders/photos/orientation.h"

#include <gmock/gmock.h>

#include "data_loaders/photos/exif_tags.h"
#include "data_loaders/photos/photos.h"
#include "tests/support/exif_photo.h"
#include "tests/support/temp_folder.h"
#include "tests/support/tiny_photos.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;

std::string turned_jpeg() {
  return {reinterpret_cast<const char*>(kTurnedJpeg), sizeof kTurnedJpeg};
}
Span<const std::uint8_t> span_of(const std::string& bytes) {
  return {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()};
}

/// 3 x 2 pixels with the values 1 2 3 / 4 5 6.
Image8 numbered() {
  Image8 image(3, 2, 1);
  for (std::size_t i = 0; i < 6; ++i) image.pixels[i] = std::uint8_t(i + 1);
  return image;
}

TEST(Orientation, EachOfTheEightTurnsThePixelsAsExifSays) {
  const auto pixels = [](int orientation) { return upright(numbered(), orientation).pixels; };
  EXPECT_THAT(pixels(1), ElementsAre(1, 2, 3, 4, 5, 6));
  EXPECT_THAT(pixels(2), ElementsAre(3, 2, 1, 6, 5, 4));
  EXPECT_THAT(pixels(3), ElementsAre(6, 5, 4, 3, 2, 1));
  EXPECT_THAT(pixels(4), ElementsAre(4, 5, 6, 1, 2, 3));
  EXPECT_THAT(pixels(5), ElementsAre(1, 4, 2, 5, 3, 6));
  EXPECT_THAT(pixels(6), ElementsAre(4, 1, 5, 2, 6, 3));
  EXPECT_THAT(pixels(7), ElementsAre(6, 3, 5, 2, 4, 1));
  EXPECT_THAT(pixels(8), ElementsAre(3, 6, 2, 5, 1, 4));
  EXPECT_EQ(upright(numbered(), 6).width, 2);
  EXPECT_EQ(upright_size({3, 2}, 8).height, 3);
  EXPECT_EQ(upright_size({3, 2}, 3).height, 2);
}

TEST(Orientation, ATurnGoesClockwiseAndEachHasAnInverse) {
  EXPECT_THAT(turned(numbered(), 90).pixels, ElementsAre(4, 1, 5, 2, 6, 3));
  EXPECT_THAT(turned(turned(numbered(), 90), 90).pixels, turned(numbered(), 180).pixels);
  EXPECT_THAT(turned(turned(numbered(), 90), 270).pixels, numbered().pixels);
  EXPECT_EQ(turned_size({3, 2}, 270).height, 3);
  for (int orientation = 1; orientation <= 8; ++orientation)
    EXPECT_EQ(as_stored(upright(numbered(), orientation), orientation).pixels, numbered().pixels);
}

TEST(Orientation, IsReadByEveryBuild) {
  const TempFolder temp;
  write_bytes(temp.path() / "turned.jpg", turned_jpeg());
  write_bytes(temp.path() / "plain.jpg", exposed_photo(16, 8, {0.008, 2.8, 400}));
  EXPECT_EQ(read_photo_orientation(temp.path() / "turned.jpg"), 6);
  EXPECT_EQ(read_photo_orientation(temp.path() / "plain.jpg"), 1);
  EXPECT_EQ(orientation_of_jpeg(span_of(turned_jpeg())), 6);
  EXPECT_EQ(orientation_of_jpeg(span_of("no photo")), 1);
}

TEST(Orientation, ACopyIsUprightAndSaysSo) {
  const TempFolder temp;
  const fs::path photo = temp.path() / "turned.jpg";
  write_bytes(photo, turned_jpeg());
  const Image8 seen = read_upright(photo);
  for (const char* name : {"copy.jpg", "copy.png"}) {
    const fs::path copy = temp.path() / name;
    write_copy(photo, seen, copy);
    EXPECT_EQ(read_photo_orientation(copy), 1) << name;
    const Image8 image = read_photo(copy);
    ASSERT_EQ(image.width, 8) << name;
    ASSERT_EQ(image.height, 16) << name;
    EXPECT_GT(image.at(4, 1, 0), 150) << name;  // red at the top
    EXPECT_LT(image.at(4, 1, 2), 100) << name;
    EXPECT_GT(image.at(4, 14, 2), 150) << name;  // blue at the bottom
  }
}

TEST(Orientation, ACopyKeepsTheTagsOfThePhoto) {
  const TempFolder temp;
  const fs::path photo = temp.path() / "photo.jpg", copy = temp.path() / "copy.jpg";
  write_bytes(photo, exposed_photo(16, 8, {0.008, 2.8, 400}));
  write_copy(photo, read_upright(photo), copy);
  ASSERT_TRUE(read_exposure_stops(copy));
  EXPECT_NEAR(*read_exposure_stops(copy), *read_exposure_stops(photo), 1e-3);
}

TEST(Orientation, OwnReaderOfTagsTurnsOnlyTheOrientation) {
  const std::string turned = turned_jpeg();
  const std::vector<std::uint8_t> segment = upright_exif_of_jpeg(span_of(turned));
  ASSERT_EQ(segment.size(), 36u);
  int differing = 0;
  for (std::size_t i = 0; i < segment.size(); ++i)
    differing += segment[i] != std::uint8_t(turned[2 + i]);
  EXPECT_EQ(differing, 1);
  EXPECT_EQ(orientation_of_jpeg(
                span_of(std::string("\xff\xd8") + std::string(segment.begin(), segment.end()))),
            1);
  for (std::size_t size = 0; size < 40; ++size)  // nothing is read beyond the end
    upright_exif_of_jpeg(span_of(turned.substr(0, size)));
}

}  // namespace
}  // namespace gs
