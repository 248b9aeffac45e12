// SPDX-License-Identifier: Apache-2.0
// Counter-based random numbers: Philox4x32-10 (Salmon et al. 2011, "Parallel random numbers: as
// easy as 1, 2, 3"). A value depends on (seed, stream, counter) alone, never on the order of calls
// or on threads, so that a resumed or parallel run draws the same numbers.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// The use of the numbers. Streams are independent of each other.
enum class RandomStream : std::uint32_t {
  view_order,
  background,
  split_gaussians,
  initialize,
  test,
  relocate,
  grow,
  position_noise,
  initial_time,
  growth = 10,  // 9 was that of noise on times
  alignment,
  moment_rounding,
  score_photos,
  mesh_samples,
  surface_neighbors
};

struct RandomBits {
  std::uint32_t word[4];
};

/// One Philox4x32-10 block: 128 random bits for the 128-bit counter under the 64-bit key.
GS_HD RandomBits philox(RandomBits counter, std::uint32_t key0, std::uint32_t key1) {
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t product0 = std::uint64_t(0xD2511F53u) * counter.word[0];
    const std::uint64_t product1 = std::uint64_t(0xCD9E8D57u) * counter.word[2];
    counter = {{std::uint32_t(product1 >> 32) ^ counter.word[1] ^ key0, std::uint32_t(product1),
                std::uint32_t(product0 >> 32) ^ counter.word[3] ^ key1, std::uint32_t(product0)}};
    key0 += 0x9E3779B9u;
    key1 += 0xBB67AE85u;
  }
  return counter;
}

/// The upper 64 of the 128 bits of a product.
GS_HD std::uint64_t high_product(std::uint64_t a, std::uint64_t b) {
  const std::uint64_t a0 = std::uint32_t(a), a1 = a >> 32, b0 = std::uint32_t(b), b1 = b >> 32;
  const std::uint64_t middle = a1 * b0 + (a0 * b0 >> 32);
  return a1 * b1 + (middle >> 32) + ((a0 * b1 + std::uint32_t(middle)) >> 32);
}

/// Random numbers of one seed and stream, addressed by two counters (say, step and row).
struct Random {
  std::uint64_t seed;
  RandomStream stream;

  GS_HD RandomBits bits(std::uint64_t major, std::uint32_t minor = 0) const {
    return philox(
        {{std::uint32_t(major), std::uint32_t(major >> 32), minor, std::uint32_t(stream)}},
        std::uint32_t(seed), std::uint32_t(seed >> 32));
  }
  /// Four numbers uniform in (0, 1).
  GS_HD Vec4f uniform4(std::uint64_t major, std::uint32_t minor = 0) const {
    const RandomBits b = bits(major, minor);
    return {unit(b.word[0]), unit(b.word[1]), unit(b.word[2]), unit(b.word[3])};
  }
  /// Four independent standard normal numbers (Box & Muller 1958).
  GS_HD Vec4f normal4(std::uint64_t major, std::uint32_t minor = 0) const {
    using std::cos, std::log, std::sin, std::sqrt;
    const Vec4f u = uniform4(major, minor);
    const float kTwoPi = 6.28318530717958648f;
    const float r0 = sqrt(-2.0f * log(u.x)), r1 = sqrt(-2.0f * log(u.z));
    return {r0 * cos(kTwoPi * u.y), r0 * sin(kTwoPi * u.y), r1 * cos(kTwoPi * u.w),
            r1 * sin(kTwoPi * u.w)};
  }
  /// A whole number in [0, bound), bound > 0.
  GS_HD std::uint32_t below(std::uint32_t bound, std::uint64_t major,
                            std::uint32_t minor = 0) const {
    return std::uint32_t((std::uint64_t(bits(major, minor).word[0]) * bound) >> 32);
  }
  /// An integer below a bound, for bounds beyond 32 bits.
  GS_HD std::uint64_t below64(std::uint64_t bound, std::uint64_t major,
                              std::uint32_t minor = 0) const {
    const RandomBits b = bits(major, minor);
    return high_product(std::uint64_t(b.word[1]) << 32 | b.word[0], bound);
  }

 private:
  // The middle of one of 2^23 equal parts of (0, 1): exact in a float, never 0 and never 1.
  GS_HD static float unit(std::uint32_t word) { return (float(word >> 9) + 0.5f) * 0x1p-23f; }
};

}  // namespace gs
