// SPDX-License-Identifier: Apache-2.0
// The one way in which TOML is read: configs, their bases, `--set`, files of experiments.
#pragma once

#include <toml++/toml.h>

#include <filesystem>
#include <string>
#include <string_view>

namespace gs {

/// Levels of tables, lists and parts of a dotted key (a.b.c has three) at one place of a text. Real
/// configs have three. The parser and all that walks a table call themselves for each level.
inline constexpr int kDeepestToml = 32;

/// The text of a TOML file of at most 1 MiB; a pipe that the shell made is read, too. Throws Error.
std::string read_toml_text(const std::filesystem::path& file);

/// The table in a text. `shown` names the text in messages: "runs/a.toml", "preset fast". Throws
/// UsageError "SHOWN:LINE: ..." for what is no TOML or nests deeper than kDeepestToml.
toml::table parse_toml(std::string_view text, const std::string& shown);

/// A value as TOML on one line: "[0.01, 'a']" comes back as [0.01, "a"]. (toml++ has a formatter, but
/// of version 3.3 the one for lists casts the negative logarithm of 0.01 to an unsigned number.)
std::string text_of(const toml::node& node);

}  // namespace gs
