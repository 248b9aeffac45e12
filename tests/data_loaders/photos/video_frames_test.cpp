// SPDX-License-Identifier: Apache-2.0
// Frames from generated videos, in which noise is sharp and a gradient is not.
#include "data_loaders/video/video_frames.h"
#include "data_loaders/video/sharpest_frames.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <mutex>

#include "data_loaders/photos/photos.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/error.h"
#include "tests/support/avi_writer.h"
#include "tests/support/error_of.h"
#include "tests/support/foreign_leaks.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kWidth = 64, kHeight = 48;

Image8 blurred(int i) {
  Image8 frame(kWidth, kHeight, 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int c = 0; c < 3; ++c) frame.at(x, y, c) = std::uint8_t(x + y + 2 * c + i);
  return frame;
}
Image8 sharp(int i) { return random_photo(kWidth, kHeight, std::uint64_t(i)); }

class VideoFrames : public testing::Test {
 protected:
  void SetUp() override {
    if (!can_read_videos()) GTEST_SKIP() << "built without OpenCV";
  }
  fs::path video() const { return temp_.path() / "walk.avi"; }
  fs::path folder() const { return temp_.path() / "images"; }
  void write(int count, const std::vector<int>& sharp_ones) const {
    std::vector<Image8> frames;
    for (int i = 0; i < count; ++i)
      frames.push_back(std::ranges::count(sharp_ones, i) ? sharp(i) : blurred(i));
    write_avi(video(), frames);
  }
  std::vector<std::string> take(int wanted, const FrameProgress& progress = {}) const {
    return take_frames(video(), count_frames(video()), wanted, folder(), "walk", progress);
  }
  std::string error_of_take() const {
    return error_of([&] { take(3); });
  }

  TempFolder temp_;
};

TEST_F(VideoFrames, SharpestOfEachStretchIsWrittenAsItIs) {
  write(30, {3, 17, 24});
  EXPECT_EQ(count_frames(video()), 30);
  std::int64_t last = 0;
  const std::vector<std::string> names = take(3, [&](std::int64_t done) { last = done; });
  EXPECT_THAT(names, ElementsAre("walk_000003.png", "walk_000017.png", "walk_000024.png"));
  EXPECT_EQ(last, 30);
  EXPECT_EQ(read_photo(folder() / names[1]).pixels, sharp(17).pixels);
}

TEST_F(VideoFrames, ThereAreAsManyAsWantedAndNamesSortByTime) {
  write(47, {5, 6, 30});
  const std::vector<std::string> names = take(10);
  EXPECT_EQ(names.size(), 10u);
  EXPECT_TRUE(std::is_sorted(names.begin(), names.end()));
}

TEST_F(VideoFrames, ShortVideoGivesAllItsFrames) {
  write(5, {});
  EXPECT_EQ(take(200).size(), 5u);
}

TEST_F(VideoFrames, SameCallGivesTheSameFiles) {
  write(20, {2, 11});
  const std::vector<std::string> names = take(4);
  const std::string first = read_bytes(folder() / names[0]);
  EXPECT_EQ(take(4), names);
  EXPECT_EQ(read_bytes(folder() / names[0]), first);
}

TEST_F(VideoFrames, DamagedFileIsNamedWithARemedy) {
  const IgnoreForeignLeaks ignore;  // from OpenCV's backends
  write_bytes(video(), std::string(5000, 'x'));
  EXPECT_THAT(error_of_take(), AllOf(HasSubstr(video().string()), HasSubstr("ffmpeg")));
  fs::remove(video());
  EXPECT_THAT(error_of_take(), HasSubstr("no such file"));
}

TEST_F(VideoFrames, AFileThatIsNoVideoIsGivenToNoOtherReader) {
  const fs::path picture = temp_.path() / "walk_01.avi";  // as a row of pictures is named
  write_bytes(picture, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\nabc\x80xyz\x80");
  EXPECT_THROW(read_frame(picture, 0), Error);
}

TEST_F(VideoFrames, AnyFrameIsTheOneOfItsNumber) {
  write(20, {0, 7, 19});
  for (const int i : {19, 0, 7}) EXPECT_EQ(read_frame(video(), i).pixels, sharp(i).pixels);
  EXPECT_EQ(read_frame(video(), 8).pixels, blurred(8).pixels);
  EXPECT_THROW(read_frame(video(), 20), Error);
}

TEST_F(VideoFrames, WantedOnesOfSeveralVideosComeInOnePass) {
  write(20, {3, 7});
  const fs::path other = temp_.path() / "other.avi";
  write_avi(other, {blurred(50), sharp(51)});
  const std::vector<VideoFrame> frames = {
      {video(), 7}, {other, 1}, {video(), 3}, {other, 0}, {video(), 9}};
  std::vector<Image8> taken(frames.size());
  std::mutex mutex;
  for_each_frame(
      frames, 2, [](std::size_t i) { return i != 3; },
      [&](std::size_t i, Image8 picture) {
        const std::lock_guard lock(mutex);
        EXPECT_TRUE(taken[i].empty());
        taken[i] = std::move(picture);
      });
  EXPECT_EQ(taken[0].pixels, sharp(7).pixels);
  EXPECT_EQ(taken[1].pixels, sharp(51).pixels);
  EXPECT_EQ(taken[2].pixels, sharp(3).pixels);
  EXPECT_TRUE(taken[3].empty());
  EXPECT_EQ(taken[4].pixels, blurred(9).pixels);
}

TEST_F(VideoFrames, OfAVideoCutShortTheBeginningIsUsed) {
  write(30, {});
  write_bytes(video(), read_bytes(video()).substr(0, 15 * (3 * kWidth * kHeight + 8)));
  const std::size_t frames = take(30).size();
  EXPECT_GE(frames, 10u);
  EXPECT_LE(frames, 15u);
}

}  // namespace
}  // namespace gs
