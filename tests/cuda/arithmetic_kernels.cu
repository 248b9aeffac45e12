// SPDX-License-Identifier: Apache-2.0
#include "tests/cuda/arithmetic_kernels.h"

#include <cstring>
#include <stdexcept>

#include "gs_core/math/arithmetic.h"
#include "gs_core/random.h"

#ifndef GS_BRANCHLESS_QUOTIENTS
#error "this file tests quotients without a branch"
#endif

namespace gs {
namespace {

constexpr int kBlocks = 2048, kThreads = 256;
constexpr std::uint64_t kStride = std::uint64_t(kBlocks) * kThreads;

__device__ std::uint64_t first_item() { return std::uint64_t(blockIdx.x) * kThreads + threadIdx.x; }

__global__ void roots_kernel(std::uint32_t least, std::uint32_t most, unsigned long long* differ) {
  unsigned long long count = 0;
  for (std::uint64_t bits = least + first_item(); bits <= most; bits += kStride) {
    const float x = __uint_as_float(std::uint32_t(bits));
    count += __float_as_uint(root(x)) != __float_as_uint(__fsqrt_rn(x));
  }
  if (count) atomicAdd(differ, count);
}

// A float from two words of random bits.
__device__ float drawn(std::uint32_t word, std::uint32_t other_word, int exponents) {
  std::uint32_t mantissa = word & 0x7fffffu;
  const std::uint32_t place = word >> 23 & 7u;
  if (place == 0) mantissa |= 0x7fff00u;
  if (place == 1) mantissa &= 0xffu;
  const std::uint32_t exponent = std::uint32_t(127 - exponents) + other_word % (2 * exponents + 1);
  return __uint_as_float((word & 0x80000000u) | exponent << 23 | mantissa);
}

__global__ void quotients_kernel(std::uint64_t count, int exponents, unsigned long long* differ) {
  unsigned long long different = 0;
  for (std::uint64_t k = first_item(); k < count; k += kStride) {
    const RandomBits bits = Random{1, RandomStream::test}.bits(k);
    const float a = drawn(bits.word[0], bits.word[1], exponents);
    const float b = drawn(bits.word[2], bits.word[3], exponents);
    different += __float_as_uint(quotient(a, b)) != __float_as_uint(__fdiv_rn(a, b));
  }
  if (different) atomicAdd(differ, different);
}

struct Results {
  float quotient, root;
};

__global__ void one_kernel(float a, float b, Results* results) {
  *results = {quotient(a, b), root(a)};
}

// What launch(pointer) leaves in memory that both sides see.
template <class T, class Launch>
T result_of(const Launch& launch) {
  T* shared = nullptr;
  if (cudaMallocManaged(&shared, sizeof(T)) != cudaSuccess)
    throw std::runtime_error("no managed memory");
  *shared = T();
  launch(shared);
  const cudaError_t error = cudaDeviceSynchronize();
  const T result = *shared;
  cudaFree(shared);
  if (error != cudaSuccess) throw std::runtime_error(cudaGetErrorString(error));
  return result;
}

Results results_of(float a, float b) {
  return result_of<Results>([&](Results* results) { one_kernel<<<1, 1>>>(a, b, results); });
}

}  // namespace

std::uint64_t differing_roots(float least, float most) {
  return result_of<unsigned long long>([&](unsigned long long* differ) {
    std::uint32_t bits[2];
    memcpy(bits, &least, sizeof least);
    memcpy(bits + 1, &most, sizeof most);
    roots_kernel<<<kBlocks, kThreads>>>(bits[0], bits[1], differ);
  });
}

std::uint64_t differing_quotients(std::uint64_t count, int exponents) {
  return result_of<unsigned long long>([&](unsigned long long* differ) {
    quotients_kernel<<<kBlocks, kThreads>>>(count, exponents, differ);
  });
}

float quotient_on_gpu(float a, float b) { return results_of(a, b).quotient; }
float root_on_gpu(float x) { return results_of(x, 1).root; }

}  // namespace gs
