// SPDX-License-Identifier: Apache-2.0
#include "gs_train/features.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>

#include "gs_core/config/config.h"
#include "gs_core/error.h"

namespace gs {

void check_supported(const Config& config, const Features& features, const std::string& name) {
  const auto check = [&](const char* key, const std::string& word,
                         const std::vector<std::string>& words) {
    if (std::find(words.begin(), words.end(), word) == words.end())
      throw UsageError(fmt::format("there is no {} {} on {}; it is one of {}", key, word, name,
                                   fmt::join(words, ", ")));
  };
  check("loss.kind", config.loss.kind, features.losses);
  check("photometric.model", config.photometric.model, features.photometric);
  if (config.render.order == RenderOrder::pixel && !features.draws_by_pixel)
    throw UsageError("render.order = \"pixel\" trains on one GPU; choose it with --device cuda:0");
  if (features.is_shared && config.density.max_gaussians == kAutoCount)
    throw UsageError(
        "density.max_gaussians = auto goes by the memory of one GPU; give a number where several "
        "processes train");
}

}  // namespace gs
