// SPDX-License-Identifier: Apache-2.0
// Pools where the system refuses threads: the work is done by those that started, or by the caller.
#include "gs_core/threads/start_threads.h"

#include <atomic>
#include <stdexcept>
#include <system_error>

#include "tests/support/test.h"

namespace gs {
namespace {

std::atomic<int> threads_left{0};

/// While it lives, the system gives this many threads more.
struct ThreadsLeft {
  explicit ThreadsLeft(int count) {
    threads_left = count;
    set_thread_hook([] {
      if (threads_left-- <= 0)
        throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
    });
  }
  ~ThreadsLeft() {
    set_thread_hook(nullptr);
    set_thread_count(0);
  }
};

TEST(StartThreads, ThoseThatStartDoTheWork) {
  const ThreadsLeft left(2);
  std::atomic<int> runs = 0;
  std::vector<std::thread> threads;
  start_threads(threads, 5, [&] { ++runs; });
  EXPECT_EQ(threads.size(), 2u);
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(runs, 2);
}

TEST(StartThreads, LoopsRunWithFewerThreadsAndWithNone) {
  for (const int count : {3, 1, 0}) {
    set_thread_count(8);
    parallel_for(2, 1, [](std::size_t) {});  // the pool is there
    const ThreadsLeft left(count);
    set_thread_count(8);  // makes it anew
    std::vector<int> visits(10'000);
    parallel_for(visits.size(), 16, [&](std::size_t i) { ++visits[i]; });
    EXPECT_EQ(visits, std::vector<int>(visits.size(), 1)) << count;
  }
}

TEST(InBackground, TheWorkIsDoneWithAThreadAndWithNone) {
  for (const int count : {1, 0}) {
    const ThreadsLeft left(count);
    std::thread::id worker;
    in_background([&] { worker = std::this_thread::get_id(); }).get();
    EXPECT_NE(worker, std::thread::id());
    EXPECT_EQ(worker == std::this_thread::get_id(), count == 0);
    std::future<void> failed = in_background([] { throw std::runtime_error("on purpose"); });
    EXPECT_THROW(failed.get(), std::runtime_error);
  }
}

}  // namespace
}  // namespace gs
