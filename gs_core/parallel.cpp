// SPDX-License-Identifier: Apache-2.0
#include "gs_core/parallel.h"

#include <omp.h>

#include <exception>

namespace gs {
namespace {
int g_thread_count = 0;  // 0: all cores
}

void set_thread_count(int threads) { g_thread_count = threads; }

int thread_count() { return g_thread_count > 0 ? g_thread_count : omp_get_num_procs(); }

namespace detail {

void run_chunks(std::size_t count, std::size_t grain, ChunkBody body, void* context) {
  const std::size_t chunks = (count + grain - 1) / grain;
  std::exception_ptr failure;
#pragma omp parallel for schedule(dynamic) num_threads(thread_count()) if (chunks > 1)
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
    try {
      body(context, chunk * grain, std::min(count, (chunk + 1) * grain));
    } catch (...) {
#pragma omp critical
      failure = std::current_exception();
    }
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace detail
}  // namespace gs
