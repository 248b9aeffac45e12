// SPDX-License-Identifier: Apache-2.0
// Weights of LPIPS in a safetensors file.
#include "gs_eval/lpips/lpips_weights.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  takes([&] {
    const LpipsWeights weights = read_lpips_weights(file_of("lpips.safetensors", bytes));
    require(smallest_picture(weights.stages) > 0, "a network sees pictures without pixels");
  });
}

const Registered registered{"lpips", read};

}  // namespace
}  // namespace gs::fuzz
