// SPDX-License-Identifier: Apache-2.0
// Clouds of points: an input is read as PLY and as LAS.
#include "data_loaders/points/point_file.h"

#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  for (const char* name : {"cloud.ply", "cloud.las"}) {
    const std::filesystem::path file = file_of(name, bytes);
    point_file_kind(file);
    takes([&] {
      for (const ColmapPoint& point : read_point_file(file))
        require(is_finite(point.position), "a point is nowhere");
    });
  }
}

const Registered registered{"points", read};

}  // namespace
}  // namespace gs::fuzz
