// SPDX-License-Identifier: Apache-2.0
#include "gs_core/threads/start_threads.h"

#include <atomic>
#include <exception>

#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/plain_message.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

std::atomic<ThreadHook> thread_hook{nullptr};

}  // namespace

void start_threads(std::vector<std::thread>& threads, int count,
                   const std::function<void()>& body) {
  int started = 0;
  try {
    threads.reserve(threads.size() + std::size_t(count));  // a thread is never lost to bad_alloc
    for (; started < count; ++started) {
      if (const ThreadHook hook = thread_hook) hook();
      threads.emplace_back(body);
    }
  } catch (const std::exception& error) {  // no thread, or no memory for one
    log_warning("{} of {} threads could be started ({}): the work goes on, and takes longer",
                started, count, plain_message(error));
  }
}

std::future<void> in_background(std::function<void()> f) {
  try {
    if (const ThreadHook hook = thread_hook) hook();
    return std::async(std::launch::async, [f] {
      const SerialLoops beside_the_pool;
      f();
    });
  } catch (const std::system_error&) {  // the work is done in any case
    std::packaged_task<void()> task(std::move(f));
    task();
    return task.get_future();
  }
}

void set_thread_hook(ThreadHook hook) { thread_hook = hook; }

}  // namespace gs
