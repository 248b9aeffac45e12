// SPDX-License-Identifier: Apache-2.0
// Settings and words that older versions had. Configs and checkpoints of older runs name them.
#pragma once

#include <string_view>

namespace gs {

struct RemovedSetting {
  std::string_view key;
  // Values with which a run is as it is without the setting, as TOML text with | between them. They
  // are read over. "*": all values.
  std::string_view unchanged;
  std::string_view why;  // other values are refused; a sentence
};

/// Null for a key that was no setting.
const RemovedSetting* find_removed_setting(std::string_view key);

/// Whether a run with this value, as TOML text, is as it is without the setting.
bool is_unchanged(const RemovedSetting& setting, std::string_view value);

/// A word as this version has it. Older versions had another one for the same.
std::string_view current_word(std::string_view key, std::string_view word);

/// Why a setting that there is does not have this word any more; empty if it never had it.
std::string_view reason_for_removed_word(std::string_view key, std::string_view word);

}  // namespace gs
