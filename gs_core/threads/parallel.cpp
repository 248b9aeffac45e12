// SPDX-License-Identifier: Apache-2.0
// A small pool of threads. The calling thread takes chunks like every other one, and waits only for
// chunks that another thread has begun. So a loop ends in good time also on a machine that is busy
// with other work; OpenMP's barriers made training several times slower there.
#include "gs_core/threads/parallel.h"

#include <atomic>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "gs_core/threads/start_threads.h"

namespace gs {
namespace {

constexpr int kSpins = 2000;  // looks for work before a thread goes to sleep, some 20 microseconds

thread_local bool t_inside_loop = false;

// One loop: its chunks, dealt out in order.
struct Loop {
  std::size_t count, grain;
  detail::ChunkBody body;
  void* context;
  std::atomic<std::size_t> next{0};
  std::mutex failure_mutex;
  std::exception_ptr failure;

  Loop(std::size_t count, std::size_t grain, detail::ChunkBody body, void* context)
      : count(count), grain(grain), body(body), context(context) {}
  void work() {
    t_inside_loop = true;
    for (std::size_t begin; (begin = next.fetch_add(grain)) < count;) {
      try {
        body(context, begin, std::min(count, begin + grain));
      } catch (...) {
        std::scoped_lock lock(failure_mutex);
        failure = std::current_exception();
      }
    }
    t_inside_loop = false;
  }
};

class Pool {
 public:
  // Where the system gives fewer threads, those that started and the caller do the work.
  explicit Pool(int workers) {
    start_threads(workers_, workers, [this] { serve(); });
  }
  ~Pool() {
    {
      std::scoped_lock lock(mutex_);
      quit_ = true;
      ++generation_;
    }
    wake_.notify_all();
    for (std::thread& worker : workers_) worker.join();
  }

  void run(Loop& loop) {
    std::scoped_lock one_loop_at_a_time(run_mutex_);
    {
      std::scoped_lock lock(mutex_);
      loop_ = &loop;
      ++generation_;
    }
    wake_.notify_all();
    loop.work();
    std::unique_lock lock(mutex_);
    loop_ = nullptr;  // threads that wake up late find no work
    done_.wait(lock, [&] { return active_ == 0; });
  }

 private:
  void serve() {
    std::uint64_t seen = 0;
    for (;;) {
      for (int i = 0; i < kSpins && generation_.load(std::memory_order_relaxed) == seen; ++i)
        std::atomic_signal_fence(std::memory_order_seq_cst);
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [&] { return generation_ != seen; });
      seen = generation_;
      if (quit_) return;
      Loop* const loop = loop_;
      if (!loop) continue;
      ++active_;
      lock.unlock();
      loop->work();
      lock.lock();
      if (--active_ == 0) done_.notify_one();
    }
  }

  std::mutex run_mutex_, mutex_;
  std::condition_variable wake_, done_;
  std::atomic<std::uint64_t> generation_{0};
  Loop* loop_ = nullptr;
  int active_ = 0;
  bool quit_ = false;
  std::vector<std::thread> workers_;
};

int g_thread_count = 0;  // 0: all cores
// Not destroyed at exit: threads may be in it, and after a fork there are none to join.
Pool* g_pool = nullptr;
std::once_flag g_pool_made;

}  // namespace

void set_thread_count(int threads) {
  const int before = thread_count();
  g_thread_count = threads;
  if (!g_pool || thread_count() == before) return;
  delete g_pool;
  g_pool = new Pool(thread_count() - 1);
}

int thread_count() {
  return g_thread_count > 0 ? g_thread_count
                            : std::max(1, int(std::thread::hardware_concurrency()));
}

SerialLoops::SerialLoops() : was_inside_(t_inside_loop) { t_inside_loop = true; }
SerialLoops::~SerialLoops() { t_inside_loop = was_inside_; }

void detail::run_chunks(std::size_t count, std::size_t grain, ChunkBody body, void* context) {
  if (count <= grain) {  // loops inside of the only chunk may take all threads
    if (count > 0) body(context, 0, count);
    return;
  }
  Loop loop(count, grain, body, context);
  if (t_inside_loop || thread_count() == 1) {
    const bool was_inside = t_inside_loop;
    loop.work();
    t_inside_loop = was_inside;
  } else {
    std::call_once(g_pool_made, [] { g_pool = new Pool(thread_count() - 1); });
    g_pool->run(loop);
  }
  if (loop.failure) std::rethrow_exception(loop.failure);
}

}  // namespace gs
