// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/photo_cache.h"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <chrono>
#include <thread>

#include "gs_core/error.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr std::uint64_t kPlenty = 1 << 30;
const std::string kKeys[] = {std::string(32, 'a'), std::string(32, 'b'), std::string(32, 'c'),
                             std::string(32, 'd')};

class PhotoCacheTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!can_cache_photos()) GTEST_SKIP() << "built without zstd or xxhash";
  }
  fs::path folder() const { return temp_.path() / "cache"; }
  fs::path file_of(const std::string& key) const {
    return folder() / key.substr(0, 2) / (key + ".gsphoto");
  }
  bool holds(const std::string& key) const { return fs::exists(file_of(key)); }
  void make_older(const std::string& key, std::chrono::hours age) const {
    fs::last_write_time(file_of(key), fs::file_time_type::clock::now() - age);
  }

  TempFolder temp_;
};

/// A gradient: smooth, as photos are.
Image8 smooth(int width, int height, int channels) {
  Image8 image(width, height, channels);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < channels; ++c) image.at(x, y, c) = std::uint8_t(2 * x + 3 * y + 50 * c);
  return image;
}

TEST_F(PhotoCacheTest, GivesBackEveryByte) {
  PhotoCache cache(folder(), kPlenty);
  for (const Image8& image : {smooth(640, 480, 3), random_photo(301, 203, 1), smooth(1, 1, 3),
                              smooth(1, 77, 1), smooth(5000, 3, 1)}) {
    cache.store(kKeys[0], image);
    const auto found = cache.find(kKeys[0], image.width, image.height, image.channels);
    ASSERT_TRUE(found) << image.width;
    EXPECT_EQ(found->pixels, image.pixels) << image.width;
  }
  cache.store(kKeys[1], smooth(640, 480, 3));
  EXPECT_LT(fs::file_size(file_of(kKeys[1])), 640u * 480 * 3 / 4);
}

TEST_F(PhotoCacheTest, MissingOrOfAnotherSizeIsNothing) {
  PhotoCache cache(folder(), kPlenty);
  EXPECT_FALSE(cache.find(kKeys[0], 8, 6, 3));
  cache.store(kKeys[0], smooth(8, 6, 3));
  EXPECT_FALSE(cache.find(kKeys[0], 6, 8, 3));
}

TEST_F(PhotoCacheTest, DamagedOrShortEntryIsRemovedAndNeverShown) {
  PhotoCache cache(folder(), kPlenty);
  const Image8 image = smooth(16, 9, 3);
  cache.store(kKeys[0], image);
  const std::string good = read_bytes(file_of(kKeys[0]));
  ASSERT_GT(good.size(), 40u);
  for (std::size_t i = 0; i < good.size(); ++i) {
    std::string bad = good;
    bad[i] = char(bad[i] ^ (1 << (i % 8)));
    write_bytes(file_of(kKeys[0]), bad);
    EXPECT_FALSE(cache.find(kKeys[0], 16, 9, 3)) << "byte " << i;
    EXPECT_FALSE(holds(kKeys[0])) << "byte " << i;
    write_bytes(file_of(kKeys[0]), good.substr(0, i));
    EXPECT_FALSE(cache.find(kKeys[0], 16, 9, 3)) << i << " bytes left";
  }
  write_bytes(file_of(kKeys[0]), good + "x");
  EXPECT_FALSE(cache.find(kKeys[0], 16, 9, 3));
  cache.store(kKeys[0], image);
  EXPECT_EQ(cache.find(kKeys[0], 16, 9, 3)->pixels, image.pixels);
}

TEST_F(PhotoCacheTest, AnEntryUnderTheNameOfAnotherIsNotTaken) {
  PhotoCache cache(folder(), kPlenty);
  const Image8 a = random_photo(16, 9, 3), b = smooth(16, 9, 3);
  cache.store(kKeys[0], a);
  cache.store(kKeys[1], b);
  fs::rename(file_of(kKeys[1]), temp_.path() / "aside");
  fs::rename(file_of(kKeys[0]), file_of(kKeys[1]));
  fs::rename(temp_.path() / "aside", file_of(kKeys[0]));
  EXPECT_FALSE(cache.find(kKeys[0], 16, 9, 3));
  EXPECT_FALSE(cache.find(kKeys[1], 16, 9, 3));
  cache.store(kKeys[0], a);
  EXPECT_EQ(cache.find(kKeys[0], 16, 9, 3)->pixels, a.pixels);
}

TEST_F(PhotoCacheTest, NothingIsReadFromAFifo) {
  PhotoCache cache(folder(), kPlenty);
  fs::create_directories(file_of(kKeys[0]).parent_path());
  ASSERT_EQ(::mkfifo(file_of(kKeys[0]).c_str(), 0600), 0);
  EXPECT_FALSE(cache.find(kKeys[0], 8, 6, 3));  // and does not wait for ever
}

TEST_F(PhotoCacheTest, KeyIsOfContentAndRecipeAlone) {
  write_bytes(temp_.path() / "a.jpg", std::string(700000, 'x'));
  write_bytes(temp_.path() / "b.jpg", std::string(700000, 'x'));
  write_bytes(temp_.path() / "c.jpg", std::string(699999, 'x') + "y");
  const std::string key = PhotoCache::key_of(temp_.path() / "a.jpg", "as it is");
  EXPECT_EQ(key.size(), 32u);
  EXPECT_EQ(key.find_first_not_of("0123456789abcdef"), key.npos);
  EXPECT_EQ(PhotoCache::key_of(temp_.path() / "b.jpg", "as it is"), key);
  EXPECT_NE(PhotoCache::key_of(temp_.path() / "c.jpg", "as it is"), key);
  EXPECT_NE(PhotoCache::key_of(temp_.path() / "a.jpg", "smaller"), key);
  EXPECT_THROW(PhotoCache::key_of(temp_.path() / "none.jpg", ""), Error);
}

TEST_F(PhotoCacheTest, WhatWasUsedLongestAgoMakesRoom) {
  const Image8 image = random_photo(64, 64, 3);  // 12 KiB, and no less when compressed
  {
    PhotoCache earlier(folder(), kPlenty);
    for (int i = 0; i < 3; ++i) earlier.store(kKeys[i], image);
  }
  make_older(kKeys[0], 1h);
  make_older(kKeys[1], 3h);
  make_older(kKeys[2], 2h);
  write_bytes(folder() / "aa" / "my holiday.jpg", std::string(50000, 'x'));
  write_bytes(folder() / "list.txt", std::string(50000, 'x'));
  PhotoCache cache(folder(), 3 * fs::file_size(file_of(kKeys[0])) + 100);
  cache.store(kKeys[3], image);
  EXPECT_TRUE(holds(kKeys[0]));
  EXPECT_FALSE(holds(kKeys[1]));
  EXPECT_TRUE(holds(kKeys[2]));
  EXPECT_TRUE(holds(kKeys[3]));
  EXPECT_TRUE(fs::exists(folder() / "aa" / "my holiday.jpg"));
  EXPECT_TRUE(fs::exists(folder() / "list.txt"));
}

TEST_F(PhotoCacheTest, EntriesOfAnyKindAreFoundAndMakeRoom) {
  const Image8 image = random_photo(64, 64, 3);
  const std::string masked = kKeys[0] + "m";
  {
    PhotoCache earlier(folder(), kPlenty);
    earlier.store(masked, image);
    EXPECT_EQ(earlier.find(masked, 64, 64, 3)->pixels, image.pixels);
    EXPECT_FALSE(earlier.find(kKeys[0], 64, 64, 3));
  }
  make_older(masked, 1h);
  PhotoCache cache(folder(), fs::file_size(file_of(masked)) + 100);
  cache.store(kKeys[1], image);
  EXPECT_FALSE(holds(masked));
  EXPECT_TRUE(holds(kKeys[1]));
}

TEST_F(PhotoCacheTest, WhatThisRunUsesIsNeverRemovedForIt) {
  const Image8 image = random_photo(64, 64, 3);
  {
    PhotoCache earlier(folder(), kPlenty);
    earlier.store(kKeys[0], image);
  }
  make_older(kKeys[0], 1h);
  PhotoCache cache(folder(), 2 * fs::file_size(file_of(kKeys[0])) + 100);
  EXPECT_TRUE(cache.find(kKeys[0], 64, 64, 3));
  for (int i = 1; i < 4; ++i) cache.store(kKeys[i], image);
  EXPECT_TRUE(holds(kKeys[0]));
  EXPECT_TRUE(holds(kKeys[1]));
  EXPECT_FALSE(holds(kKeys[2]));
  EXPECT_FALSE(holds(kKeys[3]));
}

TEST_F(PhotoCacheTest, FolderThatCannotBeMadeEndsStoringAndNothingElse) {
  write_bytes(folder(), "a file where the folder should be");
  PhotoCache cache(folder(), kPlenty);
  for (int i = 0; i < 3; ++i) cache.store(kKeys[i], smooth(8, 6, 3));
  EXPECT_FALSE(cache.find(kKeys[0], 8, 6, 3));
  EXPECT_EQ(read_bytes(folder()), "a file where the folder should be");
}

TEST_F(PhotoCacheTest, ThreadsMayWriteAndReadTheSameEntries) {
  PhotoCache cache(folder(), kPlenty);
  const Image8 image = smooth(200, 100, 3);
  std::atomic<int> wrong = 0;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int i = 0; i < 50; ++i) {
        cache.store(kKeys[i % 2], image);
        const auto found = cache.find(kKeys[i % 2], 200, 100, 3);
        wrong += !found || found->pixels != image.pixels;
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  std::size_t files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder()))
    files += entry.is_regular_file();
  EXPECT_EQ(files, 2u);  // and no temporary one
}

}  // namespace
}  // namespace gs
