// SPDX-License-Identifier: Apache-2.0
// How GPUs of several processes are linked: what is said where NCCL is missing, which needs no GPU,
// and what goes from one GPU to another.
#include <cuda_runtime_api.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "cuda/backend.h"
#include "cuda/ranks/nccl.h"
#include "gs_core/buffer.h"
#include "gs_core/error.h"
#include "tests/support/error_of.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(Nccl, ThatIsMissingIsSaidWithTheRemedy) {
  EXPECT_THAT(error_of([] { cuda::load_nccl("/nowhere/libnccl.so.2"); }),
              AllOf(HasSubstr("/nowhere/libnccl.so.2"), HasSubstr("libnccl2"),
                    HasSubstr("GEMSPLAT_NCCL"), HasSubstr("--gpus N")));
  EXPECT_THROW(cuda::load_nccl("/nowhere/libnccl.so.2"), UsageError);
}

TEST(Nccl, IsNotTakenFromAnyOtherLibrary) {
  EXPECT_THAT(error_of([] { cuda::load_nccl("libm.so.6"); }),
              AllOf(HasSubstr("libm.so.6 has no function nccl"), HasSubstr("GEMSPLAT_NCCL")));
}

TEST(Nccl, HasAVersionInWords) {
  EXPECT_EQ(cuda::nccl_version_text(22809), "2.28.9");
  EXPECT_EQ(cuda::nccl_version_text(2708), "2.7.8");
}

/// Two ranks, on two GPUs. Each sends the other some bytes, several times, and reads what came.
class TwoLinks {
 public:
  explicit TwoLinks(std::vector<std::unique_ptr<cuda::DeviceLinks>> links)
      : links_(std::move(links)), invitation_(links_.front()->invitation()) {}
  /// As rank `rank`: whether all that came was what was sent.
  bool talk(int rank) {
    const auto backend = cuda::make_backend(rank % cuda::device_count());
    const auto link = links_[std::size_t(rank)]->connect(rank % cuda::device_count(), rank, 2,
                                                         invitation_, [] {});
    Memory& memory = backend->memory();
    for (int round = 1; round <= 5; ++round) {
      const std::size_t size = 1000 * std::size_t(round);
      Buffer<int> sent(size, memory), received(2 * size, memory);
      sent.upload(std::vector<int>(size, 10 * round + rank));
      const int other = 1 - rank;
      const std::size_t bytes = size * sizeof(int);
      link->exchange({{other, sent.data(), bytes}, {other, sent.data(), bytes}},
                     {{other, received.data(), bytes}, {other, received.data() + size, bytes}},
                     nullptr);
      cudaStreamSynchronize(nullptr);
      const std::vector<int> expected(2 * size, 10 * round + other);
      if (received.download() != expected) return false;
      link->check();
    }
    return true;
  }

 private:
  std::vector<std::unique_ptr<cuda::DeviceLinks>> links_;
  const std::vector<std::byte> invitation_;
};

void expect_to_talk(std::vector<std::unique_ptr<cuda::DeviceLinks>> links) {
  TwoLinks two(std::move(links));
  bool first = false, second = false;
  std::thread other([&] { second = two.talk(1); });
  first = two.talk(0);
  other.join();
  EXPECT_TRUE(first && second);
}

TEST(Links, OfThreadsCarryWhatIsSent) {
  if (cuda::device_count() == 0) GTEST_SKIP() << "the driver reports no GPU";
  expect_to_talk(cuda::make_thread_links(2));
}

TEST(Links, OfNcclCarryWhatIsSent) {
  if (cuda::device_count() < 2) GTEST_SKIP() << "NCCL links two GPUs, and there are fewer";
  std::vector<std::unique_ptr<cuda::DeviceLinks>> links;
  try {
    for (int rank = 0; rank < 2; ++rank) links.push_back(cuda::make_nccl_links());
  } catch (const UsageError& error) {
    GTEST_SKIP() << error.what();
  }
  expect_to_talk(std::move(links));
}

TEST(Links, ThatWereGivenUpSaySo) {
  if (cuda::device_count() == 0) GTEST_SKIP() << "the driver reports no GPU";
  const auto links = cuda::make_thread_links(1);
  const auto link = links.front()->connect(0, 0, 1, {}, [] {});
  link->exchange({}, {}, nullptr);
  link->give_up();
  EXPECT_THROW(link->check(), cuda::LinkLost);
  EXPECT_THROW(link->exchange({}, {}, nullptr), cuda::LinkLost);
}

}  // namespace
}  // namespace gs
