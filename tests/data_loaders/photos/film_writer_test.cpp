// SPDX-License-Identifier: Apache-2.0
// Films, written and read back frame by frame.
#include "data_loaders/video/film_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>

#include "data_loaders/photos/photos.h"
#include "data_loaders/video/sharpest_frames.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "tests/support/error_of.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr int kWidth = 64, kHeight = 48, kFrames = 12;

/// A smooth picture that differs for each number, as codecs expect.
Image8 frame_of(int number) {
  Image8 frame(kWidth, kHeight, 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      frame.at(x, y, 0) = std::uint8_t(20 + 19 * number);
      frame.at(x, y, 1) = std::uint8_t(3 * x);
      frame.at(x, y, 2) = std::uint8_t(200 - 4 * y);
    }
  return frame;
}

double mean_difference(const Image8& a, const Image8& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i)
    sum += std::abs(int(a.pixels[i]) - int(b.pixels[i]));
  return sum / double(a.pixels.size());
}

class Film : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!can_write_films()) GTEST_SKIP() << cannot_write_films();
  }
  fs::path path(const std::string& name) const { return folder_.path() / name; }
  std::size_t files() const {
    return std::size_t(std::distance(fs::directory_iterator(folder_.path()), {}));
  }
  TempFolder folder_;
};

TEST_F(Film, FollowsNoLinkThatWaitsUnderAGuessedName) {
  write_bytes(path("victim"), "precious");
  fs::create_symlink(path("victim"), path(".a.mp4." + std::to_string(::getpid()) + ".mp4"));
  FilmWriter film(path("a.mp4"), kWidth, kHeight, 25);
  for (int i = 0; i < kFrames; ++i) film.write(frame_of(i));
  film.commit();
  EXPECT_EQ(read_bytes(path("victim")), "precious");
}

TEST_F(Film, HasItsFramesItsSizeAndItsColors) {
  FilmWriter film(path("a.mp4"), kWidth, kHeight, 25);
  for (int i = 0; i < kFrames; ++i) film.write(frame_of(i));
  EXPECT_FALSE(fs::exists(path("a.mp4")));
  film.commit();
  ASSERT_EQ(files(), 1u);  // nothing beside it
  EXPECT_EQ(count_frames(path("a.mp4")), kFrames);
  const auto names = take_frames(path("a.mp4"), kFrames, kFrames, path("frames"), "f", {});
  ASSERT_EQ(names.size(), std::size_t(kFrames));
  for (int i = 0; i < kFrames; ++i) {
    const Image8 read = read_photo(path("frames") / names[std::size_t(i)]);
    ASSERT_EQ(read.width, kWidth);
    ASSERT_EQ(read.height, kHeight);
    // The codec stores one color for four pixels, in 8 bits of another color space. The next frame
    // differs by 6.
    EXPECT_LT(mean_difference(read, frame_of(i)), 4) << i;
  }
}

TEST_F(Film, GrayFramesAreGray) {
  FilmWriter film(path("gray.mp4"), kWidth, kHeight, 30);
  film.write(Image8(kWidth, kHeight, 1, 130));
  film.commit();
  const auto names = take_frames(path("gray.mp4"), 1, 1, folder_.path(), "f", {});
  EXPECT_LT(mean_difference(read_photo(path(names.at(0))), Image8(kWidth, kHeight, 3, 130)), 4);
}

TEST_F(Film, WithoutCommitNothingIsLeftAndAnOlderFilmStays) {
  write_bytes(path("a.mp4"), "somebody's");
  {
    FilmWriter film(path("a.mp4"), kWidth, kHeight, 25);
    film.write(frame_of(0));
    EXPECT_EQ(files(), 2u);
  }
  EXPECT_EQ(files(), 1u);
  EXPECT_EQ(read_bytes(path("a.mp4")), "somebody's");
}

TEST_F(Film, MakesItsFolderAndNamesAPlaceThatItCannotWriteTo) {
  {
    FilmWriter film(path("new/folder/a.mp4"), kWidth, kHeight, 25);
    film.write(frame_of(0));
    film.commit();
  }
  EXPECT_EQ(count_frames(path("new/folder/a.mp4")), 1);
  write_bytes(path("file"), "no folder");
  EXPECT_THAT(error_of([&] { FilmWriter(path("file/a.mp4"), kWidth, kHeight, 25); }),
              HasSubstr(path("file/a.mp4").string()));
}

// An encoder that dies reports nothing, so the written film is checked.
TEST_F(Film, FramesThatDoNotReachTheDiskAreAnError) {
  FilmWriter film(path("a.mp4"), kWidth, kHeight, 25);
  film.write(frame_of(0));
  for (const auto& entry : fs::directory_iterator(folder_.path())) fs::remove(entry.path());
  EXPECT_THROW(film.commit(), Error);
  EXPECT_FALSE(fs::exists(path("a.mp4")));
}

}  // namespace
}  // namespace gs
