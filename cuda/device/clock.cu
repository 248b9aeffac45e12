// SPDX-License-Identifier: Apache-2.0
#include "cuda/device/clock.cuh"

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;
constexpr unsigned long long kNanoseconds = 20'000'000;  // globaltimer ticks once in a microsecond

__device__ unsigned long long nanoseconds_now() {
  unsigned long long now;
  asm volatile("mov.u64 %0, %%globaltimer;" : "=l"(now));
  return now;
}

// Every multiprocessor works, so that the clock is that of a busy GPU. times: cycles, nanoseconds.
__global__ void count_cycles_kernel(unsigned long long* times, float* unused) {
  const unsigned long long begin = nanoseconds_now(), cycles = clock64();
  float x = float(threadIdx.x);
  unsigned long long now = begin;
  while (now - begin < kNanoseconds) {
    for (int i = 0; i < 256; ++i) x = fmaf(x, 0.999f, 1.0f);
    now = nanoseconds_now();
  }
  if (blockIdx.x == 0 && threadIdx.x == 0) {
    times[0] = clock64() - cycles;
    times[1] = now - begin;
  }
  if (x < 0) *unused = x;  // never
}

}  // namespace

double clock_mhz(Context& context, Memory& memory) {
  Buffer<unsigned long long> times(2, memory);
  Buffer<float> unused(1, memory);
  context.launch("the clock", count_cycles_kernel, std::size_t(context.multiprocessors()), kThreads,
                 times.data(), unused.data());
  const std::vector<unsigned long long> counted = times.download();
  return 1000.0 * double(counted[0]) / double(counted[1]);
}

}  // namespace gs::cuda
