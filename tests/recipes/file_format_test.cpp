// SPDX-License-Identifier: Apache-2.0
// The recipe "a file format" of docs/develop/extending.md.
#include <gtest/gtest.h>

#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"

// [recipe]
#include <spdlog/fmt/fmt.h>

#include "gs_core/system/files/atomic_file.h"
#include "gs_model/formats/formats.h"

namespace gs {

/// Writes the means alone, one a line: "x y z", world units. Throws Error.
void write_xyz(const std::filesystem::path& path, const GaussianModel& model) {
  AtomicFile file(path);  // the file is there whole or not at all
  for (const Vec3f& mean : model.gaussians.mean)
    file.write(fmt::format("{} {} {}\n", mean.x, mean.y, mean.z));
  file.commit();
}

}  // namespace gs
// [end]

namespace gs {
namespace {

TEST(RecipeFileFormat, WritesALineForEachGaussian) {
  const TempFolder folder;
  write_xyz(folder.path() / "model.xyz", random_model(5, 0));
  const std::string text = read_bytes(folder.path() / "model.xyz");
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 5);
}

}  // namespace
}  // namespace gs
