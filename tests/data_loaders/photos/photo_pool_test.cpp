// SPDX-License-Identifier: Apache-2.0
// The pool of photos that are decoded while others are in use: its budget, order and threads. The
// photos are generated: all bytes of photo i are i % 251.
#include "data_loaders/photos/photo_pool.h"

#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <set>

#include "gs_core/error.h"
#include "gs_core/math/random.h"
#include "tests/support/error_of.h"

namespace gs {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kWidth = 4, kHeight = 3;
constexpr std::size_t kHeld = 3 * kWidth * kHeight, kDecoding = 2 * kHeld;

View made_up(std::size_t index) {
  View view;
  view.photo = Image8(kWidth, kHeight, 3, std::uint8_t(index % 251));
  view.index = index;
  return view;
}

/// A pool of `count` photos that can hold this many decoded ones beside one that is being decoded.
std::shared_ptr<PhotoPool> pool_of(std::size_t count, std::size_t room, int threads,
                                   PhotoPool::Decode decode = made_up) {
  return std::make_shared<PhotoPool>(std::vector<PhotoCost>(count, {kHeld, kDecoding}),
                                     std::move(decode), room * kHeld + kDecoding, threads);
}

std::size_t budget_of(std::size_t room) { return room * kHeld + kDecoding; }

/// Views 0 .. count - 1 in a random order.
std::vector<std::size_t> epoch_of(std::size_t count, std::uint64_t number) {
  const Random random{7, RandomStream::test};
  std::vector<std::size_t> order(count);
  for (std::size_t i = 0; i < count; ++i) order[i] = i;
  for (std::size_t i = count; i > 1; --i)
    std::swap(order[i - 1], order[random.below(std::uint32_t(i), number, std::uint32_t(i))]);
  return order;
}

void wait_for(const PhotoPool& pool, std::size_t decoded) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (pool.counts().decoded < decoded && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  ASSERT_GE(pool.counts().decoded, decoded);
}

TEST(PhotoPool, TwoThousandPhotosPassThroughRoomForTen) {
  constexpr std::size_t kPhotos = 2000, kRoom = 10;
  const auto pool = pool_of(kPhotos, kRoom, 4);
  std::vector<std::size_t> order;
  for (const std::uint64_t epoch : {0, 1, 2})
    for (const std::size_t i : epoch_of(kPhotos, epoch)) order.push_back(i);
  std::deque<std::weak_ptr<const View>> seen;
  for (std::size_t i = 0; i < kPhotosAhead; ++i) pool->prefetch_decode(order[i]);
  for (std::size_t k = 0; k < order.size(); ++k) {
    if (k + kPhotosAhead < order.size()) pool->prefetch_decode(order[k + kPhotosAhead]);
    const auto view = pool->view(order[k]);
    ASSERT_EQ(view->photo.pixels, made_up(order[k]).photo.pixels) << "number " << k;
    seen.push_back(view);
    if (seen.size() > 100) seen.pop_front();
    std::set<const View*> alive;
    for (const auto& weak : seen)
      if (const auto pointer = weak.lock()) alive.insert(pointer.get());
    ASSERT_LE(alive.size() * kHeld, budget_of(kRoom));
  }
  EXPECT_LE(pool->counts().peak_bytes, budget_of(kRoom));
  EXPECT_GE(pool->counts().decoded, kPhotos);
}

TEST(PhotoPool, ExpectedPhotosAreDecodedBeforehandAndInOrder) {
  std::vector<std::size_t> decoded;
  const auto pool = pool_of(10, 10, 1, [&](std::size_t i) {
    decoded.push_back(i);
    return made_up(i);
  });
  for (const std::size_t i : {7, 2, 9, 4}) pool->prefetch_decode(i);
  wait_for(*pool, 4);
  EXPECT_THAT(decoded, ElementsAre(7, 2, 9, 4));
  for (const std::size_t i : {7, 2, 9, 4}) EXPECT_EQ(pool->view(i)->index, i);
  EXPECT_EQ(pool->counts().decoded, 4u);
}

TEST(PhotoPool, ExpectationsBeyondTheRoomWaitForIt) {
  const auto pool = pool_of(10, 3, 2);
  for (std::size_t i = 0; i < 10; ++i) pool->prefetch_decode(i);
  wait_for(*pool, 3);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_LE(pool->counts().decoded, 4u);  // no decoded photo was dropped before its use
  for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(pool->view(i)->index, i);
  EXPECT_EQ(pool->counts().decoded, 10u);
}

TEST(PhotoPool, WhatFitsIsDecodedOnce) {
  const auto pool = pool_of(20, 20, 2);
  for (const std::uint64_t epoch : {0, 1, 2})
    for (const std::size_t i : epoch_of(20, epoch)) pool->view(i);
  EXPECT_EQ(pool->counts().decoded, 20u);
}

TEST(PhotoPool, RoomForHalfThePhotosSavesHalfTheDecoding) {
  constexpr std::size_t kPhotos = 400;
  const auto pool = pool_of(kPhotos, kPhotos / 2, 1);
  for (const std::size_t i : epoch_of(kPhotos, 0)) pool->view(i);
  ASSERT_EQ(pool->counts().decoded, kPhotos);
  for (const std::uint64_t epoch : {1, 2, 3, 4})
    for (const std::size_t i : epoch_of(kPhotos, epoch)) pool->view(i);
  const double share = double(pool->counts().decoded - kPhotos) / double(4 * kPhotos);
  EXPECT_LT(share, 0.55);  // least recently used first: 0.85
}

TEST(PhotoPool, ReleasedPhotosMakeRoomFirst) {
  const auto pool = pool_of(5, 3, 1);
  for (const std::size_t i : {0, 1, 2}) pool->view(i);
  pool->release(1);
  for (const std::size_t i : {3, 4})
    pool->view(i);  // the second one needs more than dropping photo 1 frees
  const std::size_t before = pool->counts().decoded;
  pool->view(0);
  EXPECT_EQ(pool->counts().decoded, before);
  pool->view(1);
  EXPECT_EQ(pool->counts().decoded, before + 1);
}

TEST(PhotoPool, PhotoInUseStays) {
  const auto pool = pool_of(50, 1, 2);
  const auto held = pool->view(7);
  for (std::size_t i = 0; i < 50; ++i) pool->prefetch_decode(i);
  for (std::size_t i = 0; i < 50; ++i) EXPECT_EQ(pool->view(i)->index, i);
  EXPECT_EQ(pool->view(7), held);
  EXPECT_LE(pool->counts().peak_bytes, budget_of(1) + kHeld);  // two are in use at a time here
}

TEST(PhotoPool, WhoHoldsMoreThanThereIsRoomForIsServedAllTheSame) {
  const auto pool = pool_of(10, 1, 2);
  std::vector<std::shared_ptr<const View>> held;
  for (std::size_t i = 0; i < 10; ++i) held.push_back(pool->view(i));
  for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(held[i]->index, i);
  held.clear();
  for (std::size_t i = 0; i < 10; ++i) pool->view(i);
  EXPECT_LE(pool->counts().live_bytes, budget_of(1));
}

TEST(PhotoPool, FailureIsToldToWhoAsksAndTriedAgain) {
  std::atomic<bool> is_broken = true;
  const auto pool = pool_of(4, 4, 1, [&](std::size_t i) {
    if (i == 1 && is_broken) throw Error("cannot read photo 1");
    return made_up(i);
  });
  for (std::size_t i = 0; i < 4; ++i) pool->prefetch_decode(i);
  wait_for(*pool, 3);
  EXPECT_EQ(pool->view(2)->index, 2u);
  EXPECT_THAT(error_of([&] { pool->view(1); }), HasSubstr("photo 1"));
  is_broken = false;
  EXPECT_EQ(pool->view(1)->index, 1u);
  EXPECT_EQ(pool->counts().live_bytes, 4 * kHeld);
}

TEST(PhotoPool, ManyThreadsAreServedAtOnce) {
  constexpr std::size_t kPhotos = 100;
  const auto pool = pool_of(kPhotos, 8, 3);
  std::atomic<std::size_t> wrong = 0;
  std::vector<std::thread> readers;
  for (std::uint64_t reader = 0; reader < 4; ++reader)
    readers.emplace_back([&, reader] {
      for (std::uint64_t epoch = 0; epoch < 5; ++epoch)
        for (const std::size_t i : epoch_of(kPhotos, 10 * reader + epoch)) {
          pool->prefetch_decode(i);
          const auto view = pool->view(i);
          wrong += view->index != i || view->photo.pixels != made_up(i).photo.pixels;
        }
    });
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_LE(pool->counts().peak_bytes, budget_of(8));
}

TEST(PhotoPool, EndsWhileItStillHasMuchToDo) {
  std::atomic<std::size_t> decoded = 0;
  {
    const auto pool = pool_of(1000, 1000, 2, [&](std::size_t i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      ++decoded;
      return made_up(i);
    });
    for (std::size_t i = 0; i < 1000; ++i) pool->prefetch_decode(i);
  }
  EXPECT_LT(decoded, 1000u);
}

TEST(PhotoPool, ViewsKeepTheirPoolAndAskItForTheirPhotos) {
  View here = made_up(5), elsewhere;
  elsewhere.source = pool_of(9, 2, 1);
  elsewhere.index = 8;
  EXPECT_EQ(with_photo(here).get(), &here);
  prefetch_photo(here), release_photo(here);  // nothing happens without a pool
  prefetch_photo(elsewhere);
  EXPECT_EQ(with_photo(elsewhere)->photo.pixels, made_up(8).photo.pixels);
  release_photo(elsewhere);
}

// Exposures are computed after the pool was made, from the photos that it gives.
TEST(PhotoPool, AViewsExposureGoesWithItsPhoto) {
  View view;
  view.source = pool_of(3, 2, 1);
  view.index = 2;
  EXPECT_EQ(with_photo(view)->exposure, Vec3f(1));
  view.exposure = {0.5f, 1.0f, 2.0f};
  const auto exposed = with_photo(view);
  EXPECT_EQ(exposed->exposure, view.exposure);
  EXPECT_EQ(exposed->photo.pixels, made_up(2).photo.pixels);
}

}  // namespace
}  // namespace gs
