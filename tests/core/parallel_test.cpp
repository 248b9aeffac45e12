// SPDX-License-Identifier: Apache-2.0
#include "gs_core/threads/parallel.h"

#include <atomic>
#include <mutex>
#include <stdexcept>
#include <thread>
#include "tests/support/test.h"

namespace gs {
namespace {

/// Runs with each number of threads, and puts it back to all cores at the end.
class Parallel : public ::testing::TestWithParam<int> {
 protected:
  void SetUp() override { set_thread_count(GetParam()); }
  void TearDown() override { set_thread_count(0); }
};
INSTANTIATE_TEST_SUITE_P(Threads, Parallel, ::testing::Values(0, 1, 2, 3, 8));

TEST_P(Parallel, ForVisitsEveryIndexOnce) {
  for (const std::size_t count : {0, 1, 2, 7, 1000, 100'000})
    for (const std::size_t grain : {1, 3, 64, 1'000'000}) {
      std::vector<int> visits(count);
      parallel_for(count, grain, [&](std::size_t i) { ++visits[i]; });
      EXPECT_EQ(visits, std::vector<int>(count, 1)) << count << " by " << grain;
    }
}

TEST_P(Parallel, ChunksAreNotLongerThanTheGrain) {
  std::atomic<std::size_t> longest = 0, total = 0;
  parallel_chunks(1000, 64, [&](std::size_t begin, std::size_t end) {
    EXPECT_LT(begin, end);
    total += end - begin;
    std::size_t seen = longest;
    while (end - begin > seen && !longest.compare_exchange_weak(seen, end - begin)) {
    }
  });
  EXPECT_EQ(longest, 64u);
  EXPECT_EQ(total, 1000u);
}

TEST_P(Parallel, AnExceptionArrivesAfterTheLoop) {
  std::atomic<int> visits = 0;
  const auto loop = [&] {
    parallel_for(1000, 1, [&](std::size_t i) {
      ++visits;
      if (i == 500) throw std::runtime_error("five hundred");
    });
  };
  EXPECT_THROW(loop(), std::runtime_error);
  EXPECT_EQ(visits, 1000);
}

TEST_P(Parallel, ALoopRunsAfterOneThatThrew) {
  EXPECT_THROW(parallel_for(10, 1, [](std::size_t) { throw 1; }), int);
  std::atomic<int> visits = 0;
  parallel_for(10, 1, [&](std::size_t) { ++visits; });
  EXPECT_EQ(visits, 10);
}

TEST_P(Parallel, NestedLoopsVisitEverything) {
  std::vector<std::vector<int>> visits(40, std::vector<int>(50));
  parallel_for(40, 1,
               [&](std::size_t i) { parallel_for(50, 1, [&](std::size_t k) { ++visits[i][k]; }); });
  EXPECT_EQ(visits, std::vector<std::vector<int>>(40, std::vector<int>(50, 1)));
}

TEST_P(Parallel, AnExceptionOfANestedLoopArrives) {
  const auto loops = [] {
    parallel_for(10, 1, [](std::size_t) {
      parallel_for(10, 1, [](std::size_t k) {
        if (k == 3) throw std::runtime_error("three");
      });
    });
  };
  EXPECT_THROW(loops(), std::runtime_error);
}

TEST_P(Parallel, ManyShortLoopsAllComplete) {
  std::vector<int> visits(16);
  for (int loop = 0; loop < 2000; ++loop) parallel_for(16, 1, [&](std::size_t i) { ++visits[i]; });
  EXPECT_EQ(visits, std::vector<int>(16, 2000));
}

TEST_P(Parallel, LoopsStartedByTwoThreadsAtOnceBothComplete) {
  std::vector<int> a(5000), b(5000);
  std::thread other([&] { parallel_for(a.size(), 7, [&](std::size_t i) { ++a[i]; }); });
  parallel_for(b.size(), 7, [&](std::size_t i) { ++b[i]; });
  other.join();
  EXPECT_EQ(a, std::vector<int>(5000, 1));
  EXPECT_EQ(b, std::vector<int>(5000, 1));
}

/// The threads that took part in a loop whose chunks wait for `expected` threads, or give up after
/// a while.
std::size_t threads_taking_part(std::size_t expected) {
  std::mutex mutex;
  std::set<std::thread::id> seen;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  parallel_for(64, 1, [&](std::size_t) {
    const auto enough = [&] {
      std::scoped_lock lock(mutex);
      seen.insert(std::this_thread::get_id());
      return seen.size() >= expected;
    };
    while (!enough() && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
  });
  return seen.size();
}

TEST(SetThreadCount, ChangesHowManyThreadsTakePart) {
  for (const int threads : {2, 3, 1, 2}) {
    set_thread_count(threads);
    EXPECT_EQ(thread_count(), threads);
    EXPECT_EQ(threads_taking_part(std::size_t(threads)), std::size_t(threads));
  }
  set_thread_count(0);
  EXPECT_GE(thread_count(), 1);
}

}  // namespace
}  // namespace gs
