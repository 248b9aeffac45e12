// SPDX-License-Identifier: Apache-2.0
// The flags of other trainers, such as the reference trainer (Inria) and gsplat. A flag that means
// the same here is accepted and hidden from --help. For any other flag, the error names what to
// use instead. The tables are in foreign_flags.cpp.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App;
}

namespace gs {

struct CommandLine;

/// Adds the hidden flags for the settings of `section`, such as --data-dir for "dataset.".
void add_foreign_flags(CLI::App& verb, CommandLine& line, std::string_view section);

/// Rewrites habits that are no settings: `help VERB` becomes `VERB --help`, and `eval -m RUN`
/// becomes `eval RUN`. `arguments` are those of normalized_arguments().
std::vector<std::string> without_foreign_habits(std::vector<std::string> arguments);

/// What to use instead of another trainer's flag: "--resume PATH" for --start-checkpoint of
/// `train`. Empty if the flag is not in the table for that verb.
std::string own_flag(std::string_view verb, std::string_view argument);

/// What to give instead of a value that means something to another trainer: "-r 1600, ..." for
/// "dataset.resolution=-1". Empty for all other values.
std::string own_value(std::string_view flag);

}  // namespace gs
