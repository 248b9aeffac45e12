// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as PLY and compressed PLY.
#include "gs_model/formats/ply/ply.h"

#include "gs_model/formats/model_info.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  const std::filesystem::path file = file_of("model.ply", bytes);
  takes([&] {
    const GaussianModel model = read_gaussian_ply(file);
    to_json_text(inspect(model));  // `gemsplat info`
  });
  takes([&] { is_ply_with_filter_3d(file); });
}

const Registered registered{"ply", read};

}  // namespace
}  // namespace gs::fuzz
