// SPDX-License-Identifier: Apache-2.0
// Gaussians in space and time as .gs4d.
#include "gs_model/formats/gs4d/gs4d.h"

#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  takes([&] { read_gs4d(file_of("model.gs4d", bytes)); });
}

const Registered registered{"gs4d", read};

}  // namespace
}  // namespace gs::fuzz
