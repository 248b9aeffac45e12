// SPDX-License-Identifier: Apache-2.0
// From the name of a config to its text: a file, a run's folder or a preset, and the chain of names that led there.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gs {

/// One TOML text among the bases of a config.
struct ConfigSource {
  std::string shown;             // as messages name it: "runs/a.toml", "preset fast"
  std::string identity;          // the same for the same text, however it is named
  std::filesystem::path folder;  // bases are looked for here
  std::string text;
};

/// Those that are being read: each is named as base by the one before.
using ConfigChain = std::vector<ConfigSource>;

/// "a.toml -> preset fast -> ..."
std::string text_of(const ConfigChain& chain);

/// The text behind `name`: a file (relative to the folder of the last in `chain`, else to the working directory), a run's
/// folder (its config.toml), or a preset; a file wins. Throws Error that names the chain, and the nearest preset, where
/// there is none; UsageError where the text is in the chain already.
ConfigSource open_config(const std::string& name, const ConfigChain& chain);

}  // namespace gs
