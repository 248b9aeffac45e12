// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/foreign_flags.h"

#include <CLI/CLI.hpp>
#include <algorithm>

#include "apps/cli/options.h"

namespace gs {
namespace {

struct SameMeaning {
  std::string_view flag, key;  // theirs, and the setting here
};

constexpr SameMeaning kSameMeaning[] = {
    {"--data-dir", "dataset.source"},       {"--data-factor", "dataset.resolution"},
    {"--result-dir", "model.output"},       {"--lambda-dssim", "loss.lambda_dssim"},
    {"--ssim-lambda", "loss.lambda_dssim"},
};

struct OtherMeaning {
  std::string_view verb, flag, own;  // their flag, and what to use here
};

// Verbs of older versions, and flags that take other values here. Steps of densification, for example, count in a run of 30,000
// steps and scale with the run's length.
constexpr OtherMeaning kOtherMeaning[] = {
    {"gemsplat", "prune",
     "edit MODEL -o FILE --measure, with --drop opacity=..X, contribution=..PIXELS or "
     "floaters=SHARE, or with --decimate SHARE --decimate-by drop"},
    {"gemsplat", "merge", "edit FOLDER -o FILE, of the folder of a partition"},
    {"gemsplat", "convert-cameras",
     "undistort SCENE -o OUT, or COLMAP's model_converter and image_undistorter"},
    {"train", "--checkpoint-iterations", "--checkpoint-every N"},
    {"train", "--start-checkpoint", "--resume PATH"},
    {"train", "--ckpt", "--resume PATH"},
    {"train", "--ip", "--viewer --viewer-host ADDRESS"},
    {"train", "--port", "--viewer --viewer-port N"},
    {"train", "--densify-from-iter", "--set density.from_step=N, as a step of a 30,000-step run"},
    {"train", "--densify-until-iter", "--set density.until_step=N, as a step of a 30,000-step run"},
    {"train", "--densify-grad-threshold", "--set density.gradient_threshold=X"},
    {"train", "--densification-interval", "--set density.every=N"},
    {"train", "--opacity-reset-interval", "--set density.reset_opacity_every=N"},
    {"train", "--random-background", "--background random"},
    {"render", "--skip-train", "--split test"},
    {"render", "--skip-test", "--split train"},
};

struct OtherValue {
  std::string_view flag, own;  // SECTION.KEY=VALUE as theirs, and what to give here
};

constexpr OtherValue kOtherValues[] = {
    // The reference trainer shrinks photos that are wider than 1600 pixels.
    {"dataset.resolution=-1", "no -r: photos of more than 1600 pixels are reduced to 1600 anyway"},
};

// The verbs whose first positional is a model.
constexpr std::string_view kVerbsOfModels[] = {"bench", "edit",   "eval", "export",
                                               "info",  "render", "view"};

// Moves the value of -m or --model-path to the place of the positional, right behind the verb:
// anywhere else, an option that takes a list could swallow it.
void place_model(std::vector<std::string>& arguments) {
  for (auto it = arguments.begin() + 1; it != arguments.end(); ++it) {
    const std::string equals = "--model-path=";
    std::string model;
    if (it->starts_with(equals)) {
      model = it->substr(equals.size());
      arguments.erase(it);
    } else if ((*it == "-m" || *it == "--model-path") && it + 1 != arguments.end()) {
      model = it[1];
      arguments.erase(it, it + 2);
    } else {
      continue;
    }
    arguments.insert(arguments.begin() + 1, model);
    return;
  }
}

}  // namespace

void add_foreign_flags(CLI::App& verb, CommandLine& line, std::string_view section) {
  const std::string hidden;  // CLI11 hides an option without a group
  for (const SameMeaning& same : kSameMeaning)
    if (same.key.starts_with(section))
      add_setting(verb, line, std::string(same.flag), std::string(same.key), hidden);
}

std::vector<std::string> without_foreign_habits(std::vector<std::string> arguments) {
  if (arguments.empty()) return arguments;
  if (arguments.front() == "help") {
    arguments.erase(arguments.begin());
    arguments.push_back("--help");
    return arguments;
  }
  const auto* const end = std::end(kVerbsOfModels);
  if (std::find(std::begin(kVerbsOfModels), end, arguments.front()) != end) place_model(arguments);
  return arguments;
}

std::string own_value(std::string_view flag) {
  for (const OtherValue& other : kOtherValues)
    if (other.flag == flag) return std::string(other.own);
  return {};
}

std::string own_flag(std::string_view verb, std::string_view argument) {
  const std::string_view flag = argument.substr(0, argument.find('='));
  for (const OtherMeaning& other : kOtherMeaning)
    if (other.verb == verb && other.flag == flag) return std::string(other.own);
  return {};
}

}  // namespace gs
