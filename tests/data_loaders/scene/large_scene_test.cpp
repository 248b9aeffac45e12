// SPDX-License-Identifier: Apache-2.0
// Scenes whose photos exceed the memory that they may take, and photos from the disk cache. Both
// must give the same views as decoding everything at the start.
#include <gmock/gmock.h>

#include <algorithm>

#include "data_loaders/lenses/undistort.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photo_cache.h"
#include "data_loaders/photos/photo_pool.h"
#include "gs_core/error.h"
#include "gs_core/system/sanitizers.h"
#include "gs_train/loop/trainer.h"
#include "tests/support/adaptive.h"
#include "tests/support/foreign_leaks.h"
#include "tests/support/load_scene.h"
#include "tests/support/models.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr int kWidth = 24, kHeight = 18;  // pixels; SSIM needs 11

/// Writes `count` photos of random values, with `has_lens` for a camera with a lens.
void write_photos(const fs::path& folder, int count, bool has_lens = false) {
  ColmapModel model;
  if (has_lens)
    model.cameras[7] = {7, CameraModel::simple_radial, kWidth, kHeight, {20, 12, 9, 0.05}};
  else
    model.cameras[7] = {7, CameraModel::pinhole, kWidth, kHeight, {20, 20, 12, 9}};
  for (int i = 0; i < count; ++i) {
    const std::string name = std::to_string(10000 + i) + ".png";
    model.images.push_back({std::uint32_t(i + 1), name, 7, {1, 0, 0, 0}, {0.001 * i, 0.0, 0.0}});
    write_png(folder / "images" / name, random_photo(kWidth, kHeight, std::uint64_t(i)));
  }
  for (int i = 0; i < 30; ++i)
    model.points.push_back({std::uint64_t(i + 1),
                            {0.1 * (i % 6) - 0.25, 0.1 * (i / 6) - 0.2, 1.0 + 0.05 * i},
                            {std::uint8_t(8 * i), 100, 50}});
  write_binary_model(folder / "sparse/0", model);
}

class LargeScene : public testing::Test {
 protected:
  DatasetConfig dataset(double photos_in_ram = 0) const {
    DatasetConfig result;
    result.source = scene().string();
    result.photo_cache = "none";
    result.masks = "none";  // a PNG could have alpha, and room for it is kept
    result.photo_ram_gib = float(photos_in_ram * 3 * kWidth * kHeight / double(1 << 30));
    return result;
  }
  fs::path scene() const { return temp_.path() / "scene"; }
  fs::path cache() const { return temp_.path() / "cache"; }
  std::vector<fs::path> entries() const {
    std::vector<fs::path> files;
    if (!fs::exists(cache())) return files;
    for (const auto& entry : fs::recursive_directory_iterator(cache()))
      if (entry.is_regular_file()) files.push_back(entry.path());
    return files;
  }

  TempFolder temp_;
};

void expect_same_photos(const std::vector<View>& actual, const std::vector<View>& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (std::size_t i = 0; i < actual.size(); ++i) {
    const auto view = with_photo(actual[i]), other = with_photo(expected[i]);
    EXPECT_EQ(view->name, other->name);
    EXPECT_EQ(view->camera.fx, other->camera.fx);
    EXPECT_EQ(view->photo.width, other->photo.width);
    EXPECT_EQ(view->photo.pixels, other->photo.pixels) << view->name;
    EXPECT_EQ(view->mask.pixels, other->mask.pixels) << view->name;
  }
}

Gaussians trained(const Scene& scene, int steps) {
  Config config = adaptive_config();
  config.train.iterations = steps;
  const auto backend = make_scalar_backend();
  Trainer trainer(scene, config, *backend);
  trainer.run();
  return copy_of(trainer.model().gaussians);
}

TEST_F(LargeScene, PhotosStayInTheirFilesUntilTheyAreAskedFor) {
  write_photos(scene(), 40);
  const Scene large = load_scene(dataset(5)), small = load_scene(dataset());
  ASSERT_EQ(large.train_views.size(), 40u);
  EXPECT_TRUE(large.train_views[0].photo.empty());
  ASSERT_TRUE(large.train_views[0].source);
  const auto& pool = dynamic_cast<const PhotoPool&>(*large.train_views[0].source);
  EXPECT_EQ(pool.counts().decoded, 0u);
  EXPECT_FALSE(small.train_views[0].photo.empty());
  EXPECT_FALSE(small.train_views[0].source);
  EXPECT_EQ(photo_bytes(large.train_views[0]), photo_bytes(small.train_views[0]));
  expect_same_photos(large.train_views, small.train_views);
  EXPECT_LE(pool.counts().peak_bytes, 5u * 3 * kWidth * kHeight);
}

TEST_F(LargeScene, UndistortedAndResizedPhotosAreTheSameToo) {
  write_photos(scene(), 12, true);
  DatasetConfig small = dataset();
  small.resolution = 2;
  DatasetConfig large = dataset(3.9);
  large.resolution = 2;
  expect_same_photos(load_scene(large).train_views, load_scene(small).train_views);
}

TEST_F(LargeScene, MasksComeWithTheirPhotosAndFromTheCache) {
  constexpr int kPhotos = 12;
  write_photos(scene(), kPhotos);
  for (int i = 0; i < kPhotos; i += 2) {  // every other one
    Image8 mask(kWidth, kHeight, 1, 255);
    for (int x = 0; x <= i; ++x) mask.at(x, 3, 0) = std::uint8_t(9 * x);
    write_png(scene() / "masks" / (std::to_string(10000 + i) + ".png"), mask);
  }
  DatasetConfig small = dataset(), large = dataset(6.5);
  small.masks = large.masks = "";
  small.resolution = large.resolution = 2;
  const Scene expected = load_scene(small);
  EXPECT_FALSE(expected.train_views[2].mask.empty());
  EXPECT_TRUE(expected.train_views[1].mask.empty());
  const Scene lazy = load_scene(large);
  ASSERT_TRUE(lazy.train_views[0].source);
  expect_same_photos(lazy.train_views, expected.train_views);
  EXPECT_TRUE(same_bits(trained(lazy, 20), trained(expected, 20)));
  large.photo_cache = cache().string();
  if (!can_cache_photos()) return;
  for (int round = 0; round < 2; ++round)
    expect_same_photos(load_scene(large).train_views, expected.train_views);
  EXPECT_EQ(entries().size(), std::size_t(kPhotos));
}

TEST_F(LargeScene, ManyPhotosTrainToTheSameBitsWithRoomForAFew) {
#ifdef GS_THREAD_SANITIZER
  const int photos = 200;  // everything takes some twenty times as long
#else
  const int photos = 2000;
#endif
  const int steps = photos + photos / 10;
  write_photos(scene(), photos);
  const Scene large = load_scene(dataset(6)), small = load_scene(dataset());
  const auto& pool = dynamic_cast<const PhotoPool&>(*large.train_views[0].source);
  EXPECT_TRUE(same_bits(trained(large, steps), trained(small, steps)));
  EXPECT_LE(pool.counts().peak_bytes, 6u * 3 * kWidth * kHeight);
  EXPECT_GE(pool.counts().decoded, std::size_t(photos));
}

TEST_F(LargeScene, BudgetBelowTwoPhotosIsRefusedWithTheLeast) {
  write_photos(scene(), 4);
  EXPECT_THAT(error_of(dataset(1.5)),
              AllOf(HasSubstr("dataset.photo_ram_gib"), HasSubstr("--photo-ram")));
}

TEST_F(LargeScene, DamagedPhotoIsNamedWhenItsTurnComes) {
  write_photos(scene(), 6);
  const fs::path photo = scene() / "images/10003.png";
  std::string bytes = read_bytes(photo);
  // The first bytes of the pixels, without which no decoder goes on; header and end stay.
  std::fill_n(bytes.begin() + std::ptrdiff_t(bytes.find("IDAT") + 4), 16, '\xFF');
  write_bytes(photo, bytes);
  const Scene large = load_scene(dataset(3));
  for (const View& view : large.train_views) prefetch_photo(view);
  EXPECT_FALSE(with_photo(large.train_views[2])->photo.empty());
  EXPECT_THAT(error_of([&] { with_photo(large.train_views[3]); }), HasSubstr(photo.string()));
  EXPECT_FALSE(with_photo(large.train_views[4])->photo.empty());
}

class CachedScene : public LargeScene {
 protected:
  void SetUp() override {
    if (!can_cache_photos()) GTEST_SKIP() << "built without zstd or xxhash";
    write_photos(scene(), 6);
  }
  DatasetConfig halved(bool is_cached = true) const {
    DatasetConfig result = dataset();
    result.resolution = 2;
    if (is_cached) result.photo_cache = cache().string();
    return result;
  }
};

TEST_F(CachedScene, PhotosAreMadeOnceAndThenTaken) {
  const Scene plain = load_scene(halved(false));
  expect_same_photos(load_scene(halved()).train_views, plain.train_views);
  ASSERT_EQ(entries().size(), 6u);
  expect_same_photos(load_scene(halved()).train_views, plain.train_views);
  // The entry is really used: another picture in its place appears in the view.
  PhotoCache(cache(), 1 << 30).store(entries()[0].stem().string(), plain_photo(12, 9, 77));
  int changed = 0;
  const Scene again = load_scene(halved());
  for (const View& view : again.train_views)
    changed += view.photo.pixels == plain_photo(12, 9, 77).pixels;
  EXPECT_EQ(changed, 1);
}

TEST_F(CachedScene, TrainsToTheSameBitsFromTheCacheWithLittleMemory) {
  DatasetConfig large = dataset(3);
  large.photo_cache = cache().string();
  const Scene plain = load_scene(dataset());
  EXPECT_TRUE(same_bits(trained(load_scene(large), 30), trained(plain, 30)));
  EXPECT_EQ(entries().size(), 6u);
  EXPECT_TRUE(same_bits(trained(load_scene(large), 30), trained(plain, 30)));
}

TEST_F(CachedScene, ChangedPhotoIsNotTakenFromIt) {
  load_scene(halved());
  const fs::path photo = scene() / "images/10002.png";
  const auto date = fs::last_write_time(photo);
  write_png(photo, random_photo(kWidth, kHeight, 99));
  fs::last_write_time(photo, date);
  expect_same_photos(load_scene(halved()).train_views, load_scene(halved(false)).train_views);
  EXPECT_EQ(entries().size(), 7u);
}

TEST_F(CachedScene, DamagedEntriesAreMadeAnew) {
  load_scene(halved());
  for (const fs::path& entry : entries()) write_bytes(entry, read_bytes(entry).substr(0, 60));
  expect_same_photos(load_scene(halved()).train_views, load_scene(halved(false)).train_views);
  for (const fs::path& entry : entries()) EXPECT_GT(fs::file_size(entry), 60u);
}

TEST_F(CachedScene, IsUsedOnlyWhereItSavesWork) {
  DatasetConfig plain = dataset();
  plain.photo_cache = cache().string();
  load_scene(plain);
  EXPECT_TRUE(entries().empty());
  DatasetConfig unlimited = halved();
  unlimited.photo_cache_gib = 0;
  load_scene(unlimited);
  EXPECT_TRUE(entries().empty());
}

TEST_F(CachedScene, EachResolutionHasEntriesOfItsOwn) {
  load_scene(halved());
  DatasetConfig other = halved();
  other.resolution = 4;
  load_scene(other);
  EXPECT_EQ(entries().size(), 12u);
}

}  // namespace
}  // namespace gs
