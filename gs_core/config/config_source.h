// SPDX-License-Identifier: Apache-2.0
// From the name of a config to its text: a file, a run's folder or a preset, and the chain of names
// that led there.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gs {

/// One TOML text: a config, or one of its bases.
struct ConfigSource {
  std::string shown;             // as messages name it: "runs/a.toml", "preset fast"
  std::string identity;          // the same for one text under all of its names
  std::filesystem::path folder;  // bases are looked for here
  std::string text;
};

/// The texts that are being read: each is the base of the one before.
using ConfigChain = std::vector<ConfigSource>;

/// "a.toml -> preset fast -> ..."
std::string text_of(const ConfigChain& chain);

/// The text behind `name`: a file, a run's folder (its config.toml) or a preset; a file comes
/// first. A relative path starts at the folder of the last text in `chain`, or at the working
/// directory if `chain` is empty. Throws Error, which names the chain and the nearest preset, if
/// there is no such text; UsageError if it is in the chain already.
ConfigSource open_config(const std::string& name, const ConfigChain& chain);

}  // namespace gs
