// SPDX-License-Identifier: Apache-2.0
// The recipe "a file format" of docs/develop/extending.md.
#include <gtest/gtest.h>

#include "tests/support/random_model.h"

// [recipe]
#include <spdlog/fmt/fmt.h>

#include "gs_core/system/files/byte_sink.h"
#include "gs_model/formats/formats.h"

namespace gs {

/// Writes the means alone, one a line: "x y z", world units. Throws Error as the sink does.
void write_xyz(ByteSink& sink, const GaussianModel& model) {
  for (const Vec3f& mean : model.gaussians.mean)
    sink.write(fmt::format("{} {} {}\n", mean.x, mean.y, mean.z));
}

}  // namespace gs
// [end]

namespace gs {
namespace {

TEST(RecipeFileFormat, WritesALineForEachGaussian) {
  MemorySink sink("model.xyz");
  write_xyz(sink, random_model(5, 0));
  EXPECT_EQ(std::count(sink.text.begin(), sink.text.end(), '\n'), 5);
}

}  // namespace
}  // namespace gs
