// SPDX-License-Identifier: Apache-2.0
// TOML: configs and experiments. Standard input must be no pipe, because `base` may name it.
#include "gs_app/experiment/experiment_file.h"
#include "gs_app/experiment/experiment_run.h"
#include "gs_core/config/config.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

/// A config that is taken is written so that it reads back. That takes ten times as long as
/// reading, so it is tried on texts of some lengths only.
void read_config(const std::filesystem::path& file) {
  Config config;
  SettingOrigins origins;
  load_config(config, file, &origins);
  takes([&] { validate(config, origins); });
  if (std::filesystem::file_size(file) % 16 != 0) return;
  const std::string text = to_toml(config);
  Config again;
  if (takes([&] { load_config(again, file_of("again.toml", text)); }))
    require(to_toml(again) == text, "a config does not read back");
}

void read(std::string_view bytes) {
  const std::filesystem::path file = file_of("file.toml", bytes);
  std::filesystem::create_directory(folder() / "scene");
  takes([&] { read_config(file); });
  takes([&] { runs_of(read_experiment(file)); });
  takes([&] {
    Config config;
    apply_setting(config, std::string(bytes));
  });
}

const Registered registered{"settings", read};

}  // namespace
}  // namespace gs::fuzz
