// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/config_source.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <optional>

#include "gs_core/config/config_presets.h"
#include "gs_core/config/text/nearest_word.h"
#include "gs_core/config/text/read_toml.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/text_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kEnding = ".toml";

// "fast" and "fast.toml" name the preset; "./fast" and "runs/fast" do not.
const Preset* find_preset(std::string_view name) {
  if (name.ends_with(kEnding)) name.remove_suffix(kEnding.size());
  for (const Preset& preset : presets())
    if (preset.name == name) return &preset;
  return nullptr;
}

// The file that a path names; for a folder, its config.toml.
std::optional<fs::path> find_file(const fs::path& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) {
    const fs::path config = path / "config.toml";
    return fs::exists(config, ignored) ? std::optional(config) : std::nullopt;
  }
  return fs::exists(path, ignored) ? std::optional(path) : std::nullopt;
}

std::string preset_names() {
  std::string names;
  for (const Preset& preset : presets())
    names += fmt::format("{}{}", names.empty() ? "" : ", ", preset.name);
  return names;
}

// ", base of a.toml (a.toml -> b.toml)"; "" for a config that is not a base
std::string as_base_of(const ConfigChain& chain, const std::string& name) {
  if (chain.empty()) return "";
  return fmt::format(", base of {} ({} -> {})", chain.back().shown, text_of(chain), name);
}

[[noreturn]] void refuse_missing(const std::string& name, const fs::path& path,
                                 const ConfigChain& chain) {
  std::vector<std::string> known;
  for (const Preset& preset : presets()) known.emplace_back(preset.name);
  const std::string nearest = nearest_word(name, known);
  throw Error(fmt::format(
      "cannot read the config {}{}: there is no such file, no run's folder and no preset; {}",
      path.string(), as_base_of(chain, name),
      nearest.empty() ? "check the path given with -c or as base; presets are " + preset_names()
                      : "did you mean the preset " + nearest + "?"));
}

ConfigSource read_file(const fs::path& file, const ConfigChain& chain) {
  try {
    std::error_code error;  // of a pipe of the shell, whose name leads nowhere
    const fs::path canonical = fs::weakly_canonical(file, error);
    const fs::path folder = is_pipe_of_shell(file) ? fs::path() : file.parent_path();
    return {file.string(), (error ? file : canonical).string(), folder, read_toml_text(file)};
  } catch (const AccessError&) {
    throw;
  } catch (const Error& error) {
    throw Error(fmt::format("{}; a config{} is a text file that you may read", error.what(),
                            as_base_of(chain, file.string())));
  }
}

}  // namespace

std::string text_of(const ConfigChain& chain) {
  std::string text;
  for (const ConfigSource& source : chain) text += (text.empty() ? "" : " -> ") + source.shown;
  return text;
}

ConfigSource open_config(const std::string& name, const ConfigChain& chain) {
  const fs::path path = chain.empty() ? fs::path(name) : chain.back().folder / name;
  ConfigSource source;
  if (const auto file = name.empty() ? std::nullopt : find_file(path)) {
    source = read_file(*file, chain);
  } else if (const Preset* preset = find_preset(name)) {
    source = {fmt::format("preset {}", preset->name),
              fmt::format("preset {}", preset->name),
              {},
              std::string(preset->text)};
  } else {
    refuse_missing(name, path, chain);
  }
  for (const ConfigSource& other : chain)
    if (other.identity == source.identity)
      throw UsageError(
          fmt::format("{} is its own base: {} -> {}; remove one of the `base = ...` lines",
                      source.shown, text_of(chain), source.shown));
  return source;
}

}  // namespace gs
