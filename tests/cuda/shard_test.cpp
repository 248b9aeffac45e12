// SPDX-License-Identifier: Apache-2.0
// Which rows of a model several GPUs have. No GPU is needed for that.
#include "cuda/gpus/shard.h"

#include "tests/support/test.h"

namespace gs::cuda {
namespace {

TEST(Shards, HaveEachRowOnceInOrderAndInWholeWarps) {
  for (const int gpus : {1, 2, 3, 8})
    for (const std::size_t rows : {0, 1, 31, 32, 33, 95, 96, 97, 255, 256, 257, 1000}) {
      std::vector<int> owners(rows, -1);
      for (int gpu = 0; gpu < gpus; ++gpu) {
        const Shard shard(gpu, gpus, rows, 32);
        std::size_t before = 0;
        for (std::size_t local = 0; local < shard.count(); ++local) {
          const std::size_t row = shard.row_of_all(local);
          ASSERT_LT(row, rows);
          EXPECT_EQ(owners[row], -1) << row;
          owners[row] = gpu;
          if (local > 0) {
            EXPECT_GT(row, before);
          }
          EXPECT_EQ(row % 32, local % 32);
          before = row;
        }
      }
      for (const int owner : owners) EXPECT_NE(owner, -1);
    }
}

TEST(Shards, OfOneGpuAreTheModel) {
  const Shard shard;
  EXPECT_EQ(shard.row_of_all(12345), 12345u);
  EXPECT_EQ(shard.count_of_all(777), 777u);
}

TEST(Shards, HaveAboutAsManyRows) {
  for (int gpu = 0; gpu < 4; ++gpu) {
    const std::size_t rows = Shard(gpu, 4, 1'000'000).count();
    EXPECT_GE(rows, 250'000 - kChunkRows);
    EXPECT_LE(rows, 250'000 + kChunkRows);
  }
}

}  // namespace
}  // namespace gs::cuda
