// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians in a .splat, and what an error says of a file that is no format of ours.
#include "gs_model/formats/splat.h"

#include "gs_model/formats/foreign_files.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  takes([&] { read_splat(file_of("model.splat", bytes)); });
  takes([&] { foreign_kind(file_of("model", bytes)); });
}

const Registered registered{"splat", read};

}  // namespace
}  // namespace gs::fuzz
