// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/removed/removed_settings.h"

#include <algorithm>

namespace gs {
namespace {

// clang-format off
constexpr RemovedSetting kSettings[] = {
    {"model.time_colors", "false",
     "Gaussians no longer change their colors, which gained nothing on photos of the whole size; remove the line"},
    {"optimizer.time_color_lr", "*", ""},
    {"density.static_after", "0.0|0",
     "Gaussians in space and time no longer become static, since few did and nothing was gained; remove the line"},
    {"train.time_noise", "0.0|0", "the times of photos have no noise any more, which changed nothing; remove the line"},
    {"render.precision", R"("full")", "pictures are blended exactly, as by \"full\"; remove the line"},
    {"render.packed_sh", "true", "frames for viewing have SH in 16 bits; remove the line"},
    {"model.sky", R"("none")", "far Gaussians where photos show a sky gained nothing in the mean of eight scenes; remove the line"},
    {"density.pooling", R"("sum")", "scores are sums over photos, and no preset took the largest; remove the line"},
    {"density.candidate_share", "*", ""},
    {"density.replace", "false", "no preset replaced what is pruned beyond the curve; remove the line"},
    {"density.child_opacity_power", "1.0|1", "no preset used the power; remove the line"},
    {"density.first_epochs", "0", "no preset used it; set density.from_step"},
    {"density.final_steps", "0", "no preset used it; set density.until_step and density.reset_opacity_until"},
    {"optimizer.beta2", "0.999", "Adam's second beta is 0.999 for every run; remove the line"},
    {"optimizer.position_lr_final_power", "0.0|0", "no preset used it; set optimizer.position_lr_final"},
    {"train.sh_degree_epochs", "0", "no preset used it; set train.sh_degree_every"},
    {"train.batch_from_step", "0", "batches that begin late gained nothing; remove the line"},
    {"train.morton_until", "*", ""},
    {"train.morton_every", "5000", "Gaussians are sorted every 5,000 of 30,000 steps, which no preset changed; remove the line"},
    {"optimizer.position_decay_from", "0|13500", "only DashGaussian had it, as density.strategy = \"dash_gaussian\" has now; remove the line"},
    {"model.most_points", "2000000", "a run starts from at most 2,000,000 points, which no preset changed; limit it with density.max_gaussians"},
    {"density.noise_scale", "500000.0|500000|5e+05", "the noise of mcmc has the strength of its paper, which no preset changed; remove the line"},
    {"optimizer.time_mean_lr", "0.0008|8e-04", "means in time learn at 0.0008 of the duration, which no preset changed; remove the line"},
    {"loss.depth_weight_final", "0.002", "the weight of depth maps decays to a hundredth of loss.depth_weight, which no preset changed; remove the line"},
    {"poses.warmup", "1000", "the rate of poses rises for 1,000 of 30,000 steps, which no preset changed; remove the line"},
    {"poses.pull", "0.0001|1e-04", "the pull to the given poses has the weight 0.0001, which no preset changed; remove the line"},
    {"photometric.vignetting", "false",
     "vignetting is no longer learned, which cost 0.1 to 0.3 dB on real photos; remove the line"},
    {"optimizer.lazy", R"("offload"|"off"|"auto")",
     "updates of SH are no longer left for later, which saved no time beside optimizer.moments = \"half\"; remove the line"},
    {"train.rank_processes", "false",
     "gemsplat starts no processes of its own any more: one process drives all GPUs of a machine (--gpus N); remove the line"},
    {"train.rank_deadline", "*", ""},
    {"train.offload", R"("auto"|"none")",
     "models are no longer kept in host memory, which took 16 to 24 times as long; train with optimizer.moments = \"half\", or in blocks (gemsplat partition)"},
};
// clang-format on

struct RemovedWord {
  std::string_view key, word, why;
};
// clang-format off
constexpr RemovedWord kWords[] = {
    {"density.strategy", "budgeted", "its methods have names of their own: \"growth\" has the constants of the defaults, \"adaptive\" those of Kerbl et al. 2023, and docs/method/density.md lists the others"},
    {"photometric.model", "ppisp", "this model was no better than gains where both were measured; train with \"gains\""},
    {"optimizer.moments", "compact", "moments in 32 bits are larger and slower than \"half\", and no better; train with \"half\""},
};
// clang-format on

struct RenamedWord {
  std::string_view key, word, now;
};
constexpr RenamedWord kRenamedWords[] = {{"optimizer.moments", "tiny", "half"}};

}  // namespace

const RemovedSetting* find_removed_setting(std::string_view key) {
  const auto found =
      std::find_if(std::begin(kSettings), std::end(kSettings),
                   [&](const RemovedSetting& setting) { return setting.key == key; });
  return found == std::end(kSettings) ? nullptr : found;
}

bool is_unchanged(const RemovedSetting& setting, std::string_view value) {
  for (std::string_view rest = setting.unchanged; !rest.empty();) {
    const std::size_t bar = std::min(rest.find('|'), rest.size());
    if (const std::string_view one = rest.substr(0, bar); one == value || one == "*") return true;
    rest.remove_prefix(std::min(bar + 1, rest.size()));
  }
  return false;
}

std::string_view current_word(std::string_view key, std::string_view word) {
  for (const RenamedWord& renamed : kRenamedWords)
    if (renamed.key == key && renamed.word == word) return renamed.now;
  return word;
}

std::string_view reason_for_removed_word(std::string_view key, std::string_view word) {
  for (const RemovedWord& removed : kWords)
    if (removed.key == key && removed.word == word) return removed.why;
  return {};
}

}  // namespace gs
