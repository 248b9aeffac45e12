// SPDX-License-Identifier: Apache-2.0
// The recipe "a quantity per Gaussian" of docs/develop/extending.md: a parameter and a statistic.
#include <gtest/gtest.h>

#include "gs_core/model_rows.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/counted_memory.h"
#include "tests/support/models.h"

namespace gs {
namespace {

// [recipe]
/// The rows of a model, with two quantities more.
struct DatedRows : ModelRows {
  using ModelRows::ModelRows;
  Buffer<float> birth{memory()};   // (N)  step in which the Gaussian was made
  Buffer<Vec3f> travel{memory()};  // (N, 3)  way of its mean since the last refinement, world units

  Columns columns() {
    Columns all = ModelRows::columns();
    all.push_back({RowRole::parameter, "gaussians", "birth", &birth});
    all.push_back({RowRole::statistic, "statistics", "travel", &travel});
    return all;
  }
};
// [end]

/// Row i was born in step 10 i and has traveled i + 1 along every axis.
void fill(DatedRows& rows, std::size_t count) {
  for (const Column& column : rows.columns()) {
    column.rows->resize(count);
    column.rows->fill_zero();
  }
  for (std::size_t i = 0; i < count; ++i) {
    rows.birth[i] = 10.0f * float(i);
    rows.travel[i] = Vec3f(float(i + 1));
  }
}

TEST(RecipeQuantity, RowsOfItMoveWithTheOthers) {
  DatedRows rows;
  fill(rows, 4);
  const std::uint32_t source[] = {3, 0, 0};
  gather_rows(rows.columns(), {source, 3});
  EXPECT_EQ(rows.birth.download(), (std::vector<float>{30, 0, 0}));
  EXPECT_EQ(rows.travel[0], Vec3f(4));
  start_new_rows(rows.columns(), 2);  // a parameter is inherited, a statistic starts anew
  EXPECT_EQ(rows.birth.download(), (std::vector<float>{30, 0, 0}));
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(rows.travel[i], Vec3f(0));
}

TEST(RecipeQuantity, IsCopiedAndCountedLikeTheOthers) {
  DatedRows rows;
  fill(rows, 5);
  CountedMemory memory;
  DatedRows copy(memory);
  for (std::size_t k = 0; k < rows.columns().size(); ++k)
    copy.columns()[k].rows->copy_from(*rows.columns()[k].rows);
  EXPECT_EQ(copy.birth.download(), rows.birth.download());
  EXPECT_EQ(memory.allocated, 5 * (716 + sizeof(float) + sizeof(Vec3f)));
  EXPECT_EQ(copy.columns().back().key(), "statistics.travel");
}

}  // namespace
}  // namespace gs
