// SPDX-License-Identifier: Apache-2.0
// A verb's list of options as flags of CLI11.
#pragma once

#include <string>
#include <vector>

#include "gs_app/jobs/parts/option.h"

namespace CLI {
class App;
}

namespace gs {

/// Adds the options and the sub-verbs. Parsing writes the values to where the options say.
void bind_options(CLI::App& app, const OptionList& list);

/// After parsing: names what was given, and puts operations into their lists, in the order of the
/// command line.
void take_parsed(const CLI::App& app, const OptionList& list);

/// "--" arguments with '_' as '-' in their names, so that both are taken alike.
std::vector<std::string> normalized_arguments(int argc, const char* const* argv);

}  // namespace gs
