// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/parts/shared_options.h"

#include "gs_app/jobs/parts/foreign_flags.h"
#include "gs_app/jobs/parts/job.h"
#include "gs_core/config/config_presets.h"

namespace gs {
namespace {

constexpr int kMostPort = 65535;

std::vector<std::string> preset_names() {
  std::vector<std::string> names;
  for (const Preset& preset : presets()) names.emplace_back(preset.name);
  return names;
}

}  // namespace

void general_options(OptionList& option) {
  JobSettings& job = option.settings;
  option("-c,--config", job.config_files,
         "take settings from a TOML file, a run's folder or a preset; may be repeated")
      .takes("FILE|RUN|PRESET")
      .suggests(preset_names())
      .repeated()
      .group("Settings");
  option("--set", job.settings, "change one setting; wins over -c; may be repeated")
      .takes("SECTION.KEY=VALUE")
      .repeated()
      .group("Settings");
  option.setting("--device", "train.device", "Machine",
                 "where to compute; cuda:N is the GPU with that number");
  option.setting("--threads", "train.threads", "Machine").rare();
  option("-q,--quiet", job.quiet, "print warnings and errors only").group("Messages");
  option("-v,--verbose", job.verbose, "print more").group("Messages").rare();
}

void model_options(OptionList& option, ModelChoice& choice) {
  option("--iteration", choice.step,
         "which model of a run: the one saved after this step [the newest]")
      .takes("STEP")
      .rare();
}

Option& time_option(OptionList& option, std::optional<double>& time, const std::string& meaning) {
  return option("--time", time, meaning).takes("T").between(0, 1).rare();
}

void camera_options(OptionList& option, const std::string& scene_names) {
  option.setting(scene_names, "dataset.source", "Scene");
  option.setting("--images", "dataset.images", "Scene").rare();
  option.setting("-r,--resolution", "dataset.resolution", "Scene");
  option.setting("--test-every", "dataset.test_every", "Scene").rare();
  foreign_options(option, "dataset.");
}

void given_camera_options(OptionList& option, std::string& cameras, const std::string& otherwise) {
  option("--cameras", cameras,
         "cameras.json, transforms.json or the folder of a COLMAP model [" + otherwise + "]")
      .takes("FILE|FOLDER")
      .group("Scene");
  camera_options(option, "-d,--data,-s,--source-path");
  option.get("--data").excludes("--cameras");
}

void mask_options(OptionList& option) {
  option.setting("--masks", "dataset.masks", "Scene").rare();
  option.setting("--mask-mode", "dataset.mask_mode", "Scene").rare();
  option.setting("--invert-masks", "dataset.invert_masks", "Scene").rare();
}

void dataset_options(OptionList& option, const std::string& scene_names) {
  camera_options(option, scene_names);
  mask_options(option);
  option.setting("--depth", "dataset.depth", "Scene").rare();
  option.setting("--depth-kind", "dataset.depth_kind", "Scene").rare();
  option.setting("--photo-ram", "dataset.photo_ram_gib", "Machine").rare();
  option.setting("--photo-cache", "dataset.photo_cache", "Machine").rare();
}

void render_options(OptionList& option, const std::string& sh_degree_meaning) {
  option.setting("--background", "render.background", "Rendering").rare();
  Option& white = option.setting("-w,--white-background", "render.background", "Rendering");
  white.meaning = "the same as --background white";
  white.value = SettingValue{"render.background", true, false, "white"};
  white.suggested.clear();
  white.excludes("--background").rare();
  option.setting("--antialiased,--antialiasing", "render.antialias", "Rendering").rare();
  option.setting("--blend-rule", "render.blend_rule", "Rendering").rare();
  option.setting("--sh-degree", "model.sh_degree", "Rendering", sh_degree_meaning).rare();
}

void open_option(OptionList& option, std::optional<bool>& open) {
  option("--open,!--no-open", open, "open the browser [yes, if there is a desktop]")
      .group("Server");
}

Option& port_option(OptionList& option, HttpPlace& place, const std::string& prefix,
                    const std::string& heading) {
  return option(prefix + "port", place.port,
                "port to listen at; 0: any free port [the first free one from 7070 on]")
      .takes("N")
      .between(0, kMostPort)
      .group(heading);
}

void http_options(OptionList& option, HttpPlace& place, const std::string& prefix,
                  const std::string& heading) {
  option(prefix + "host", place.host, "address to listen at [127.0.0.1: this machine only]")
      .takes("ADDRESS")
      .group(heading)
      .rare();
  port_option(option, place, prefix, heading).rare();
}

}  // namespace gs
