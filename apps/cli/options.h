// SPDX-License-Identifier: Apache-2.0
// The flags that verbs share, and how they become a Config: defaults, then config files, then
// --set, then flags; a later one wins. A flag is a short name of a setting, and shows its help text.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "gs_app/view/http/http_server.h"
#include "gs_core/config/config.h"
#include "gs_core/system/log.h"

namespace CLI {
class App;
}

namespace gs {

/// What the command line says about the config, not yet applied.
struct CommandLine {
  std::vector<std::string> config_files;  // -c, in order
  std::vector<std::string> settings;      // --set, in order
  std::vector<std::string> flags;         // "section.key=value" of every flag given, in order
  bool quiet = false, verbose = false;

  Verbosity verbosity() const;
  /// Whether a flag for that setting was given.
  bool has(const std::string& key) const;
};

/// Adds a flag for the setting `key`: `names` as CLI11 takes them, `help` where the setting's own
/// meaning does not say enough.
void add_setting(CLI::App& verb, CommandLine& line, const std::string& names,
                 const std::string& key, const std::string& group, const std::string& help = {});

/// -c, --set, -q, -v, --threads, --device: what every verb that computes takes.
void add_general_options(CLI::App& verb, CommandLine& line);

/// --time: a moment of Gaussians in space and time.
void add_time_option(CLI::App& verb, std::optional<double>& time, const std::string& help);

/// What verbs that read any model say of their argument.
inline constexpr const char* kModelHelp =
    "a model of any trainer (.ply, .spz, .sog, .glb, .rad, .splat or .gs4d, or a folder with "
    "meta.json), or a run's folder";

/// The scene (`scene_names`: its flag's names), --images, -r, --test-every: all that poses and sizes of its cameras
/// depend on.
void add_camera_options(CLI::App& verb, CommandLine& line, const std::string& scene_names);
/// --masks, --mask-mode, --invert-masks.
void add_mask_options(CLI::App& verb, CommandLine& line);
/// Both, and where decoded photos are kept: for verbs that use all photos.
void add_dataset_options(CLI::App& verb, CommandLine& line, const std::string& scene_names);

/// --background, -w, --antialiased, --blend-rule, --sh-degree. If the SH degree is that of a file to
/// write, `sh_degree_help` says so.
void add_render_options(CLI::App& verb, CommandLine& line, const std::string& sh_degree_help = {});

/// Where a server listens: HOST and PORT, behind `prefix` ("--viewer-").
void add_http_place(CLI::App& verb, HttpPlace& place, const std::string& prefix,
                    const std::string& group);

/// The settings of the command line over `start`, validated; in `origins`, where given, what came
/// from where. Throws UsageError.
Config resolve(const CommandLine& line, Config start = {}, SettingOrigins* origins = nullptr);

/// The files and folders that the command line and its settings name to be read. None of them is ever
/// moved.
std::vector<std::filesystem::path> inputs_of(const CommandLine& line, const Config& config);

/// "--" arguments with '_' as '-' in their names, so that both are taken alike.
std::vector<std::string> normalized_arguments(int argc, const char* const* argv);

}  // namespace gs
