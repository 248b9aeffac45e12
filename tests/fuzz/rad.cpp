// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians with levels of detail in a .rad.
#include "gs_model/formats/lod/rad.h"

#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  takes([&] { read_rad(file_of("model.rad", bytes)); });
}

const Registered registered{"rad", read};

}  // namespace
}  // namespace gs::fuzz
