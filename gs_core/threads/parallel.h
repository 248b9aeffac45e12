// SPDX-License-Identifier: Apache-2.0
// Loops over all cores. The result of a loop must not depend on the chunks or on the number of
// threads: each index writes only its own elements, and sums are taken in a fixed order afterwards.
#pragma once

#include <algorithm>
#include <cstddef>
#include <type_traits>

namespace gs {

/// How many threads parallel loops use; 0 means all cores. Set once, before the work starts.
void set_thread_count(int threads);
int thread_count();

namespace detail {
using ChunkBody = void (*)(void* context, std::size_t begin, std::size_t end);
void run_chunks(std::size_t count, std::size_t grain, ChunkBody body, void* context);
}  // namespace detail

/// Calls body(begin, end) for consecutive chunks of at most `grain` that cover [0, count), on all
/// threads. An exception thrown by a body is thrown again here, after the loop.
template <class Body>
void parallel_chunks(std::size_t count, std::size_t grain, Body&& body) {
  detail::run_chunks(
      count, grain,
      [](void* context, std::size_t begin, std::size_t end) {
        (*static_cast<std::remove_reference_t<Body>*>(context))(begin, end);
      },
      &body);
}

/// Calls body(i) for every i in [0, count), on all threads.
template <class Body>
void parallel_for(std::size_t count, std::size_t grain, Body&& body) {
  parallel_chunks(count, grain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) body(i);
  });
}

/// While it lives, loops of the thread that made it run on that thread alone. It is for threads
/// that work beside the pool and must not delay it, such as the viewer's.
class SerialLoops {
 public:
  SerialLoops();
  ~SerialLoops();
  SerialLoops(const SerialLoops&) = delete;
  SerialLoops& operator=(const SerialLoops&) = delete;

 private:
  bool was_inside_;
};

}  // namespace gs
