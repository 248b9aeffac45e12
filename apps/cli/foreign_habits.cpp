// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/foreign_habits.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <iterator>

#include "data_loaders/video/film_frames.h"
#include "gs_app/view/view_server.h"

namespace gs {
namespace {

struct OtherMeaning {
  std::string_view verb, flag, own;  // their flag, and what to use here
};

// Verbs and flags of older versions, and flags of other programs that take other values here. Steps
// of densification, for example, count in a run of 30,000 steps and scale with the run's length.
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
    {"export", "--lod", "an output that ends in .rad, which has the levels of detail"},
    {"render", "--skip-train", "--split test"},
    {"render", "--skip-test", "--split train"},
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

bool is_verb(const std::vector<Verb>& verbs, const std::string& word) {
  return word == "self-doc" || std::any_of(verbs.begin(), verbs.end(),
                                           [&](const Verb& verb) { return word == verb.name; });
}

// `gemsplat PHOTOS` goes on with a run that is there. On a terminal it shows the run in a browser,
// until Ctrl-C.
void train_and_show(std::vector<std::string>& arguments) {
  arguments.insert(arguments.begin(), "train");
  arguments.push_back("--resume=auto");
  if (!can_view() || ::isatty(STDERR_FILENO) != 1) return;
  arguments.push_back("--viewer");
  arguments.push_back("--viewer-wait");
}

}  // namespace

std::vector<std::string> without_foreign_habits(std::vector<std::string> arguments,
                                                const std::vector<Verb>& verbs) {
  if (arguments.empty()) return arguments;
  const std::string& first = arguments.front();
  if (!is_verb(verbs, first) && (std::filesystem::is_directory(first) || is_video(first))) {
    train_and_show(arguments);
    return arguments;
  }
  if (arguments.front() == "help") {
    arguments.erase(arguments.begin());
    arguments.push_back("--help");
    return arguments;
  }
  const auto* const end = std::end(kVerbsOfModels);
  if (std::find(std::begin(kVerbsOfModels), end, arguments.front()) != end) place_model(arguments);
  return arguments;
}

std::string own_flag(std::string_view verb, std::string_view argument) {
  const std::string_view flag = argument.substr(0, argument.find('='));
  for (const OtherMeaning& other : kOtherMeaning)
    if (other.verb == verb && other.flag == flag) return std::string(other.own);
  return {};
}

}  // namespace gs
