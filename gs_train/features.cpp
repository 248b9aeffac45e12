// SPDX-License-Identifier: Apache-2.0
#include "gs_train/features.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>

#include "gs_core/config/config.h"
#include "gs_core/error.h"

namespace gs {
namespace {

// Surfaces are those of pinholes and of Gaussians that stand still, blended in the order by depth.
void check_surface(const Config& config, const Features& features) {
  const auto refuse = [](const char* remedy) {
    throw UsageError(fmt::format(
        "surface terms (surface.normal_weight, surface.photo_weight, surface.prior_weight) {}; or "
        "set all of them to 0",
        remedy));
  };
  if (config.model.dynamic) refuse("are for scenes that stand still; train without model.dynamic");
  if (config.render.order == RenderOrder::pixel) refuse("need render.order = \"z\"");
  if (config.poses.refine)
    refuse("do not teach poses; train without poses.refine, with dataset.refine_cameras");
  if (!features.trains_surfaces) refuse("train on one GPU; choose it with --device cuda:0");
  if (config.train.deterministic && !features.repeats_surfaces)
    refuse(
        "have sums of no fixed order on a GPU; train without train.deterministic, or on the CPU");
}

}  // namespace

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
  if (config.surface.is_on()) check_surface(config, features);
  if (features.is_shared && config.density.max_gaussians == kAutoCount)
    throw UsageError(
        "density.max_gaussians = auto goes by the memory of one GPU; give a number where several "
        "processes train");
}

}  // namespace gs
