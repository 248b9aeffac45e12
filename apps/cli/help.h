// SPDX-License-Identifier: Apache-2.0
// What --help and --help-all show, made from the lists of options.
#pragma once

#include <string>

#include "gs_app/jobs/parts/job.h"

namespace gs {

/// The width of the terminal at standard output, from 50 to 100 columns; 100 if it is no terminal.
std::size_t help_width();

/// The text in lines of at most `width` columns, broken at spaces, or behind a comma or bar in
/// words that are too long. Each line but the first is indented by `indent` spaces; the first
/// begins in column `start`.
std::string wrapped(const std::string& text, std::size_t start, std::size_t indent,
                    std::size_t width);

/// The whole program: its verbs, in groups.
std::string help_of_program(const std::vector<Verb>& verbs, std::size_t width);

/// A verb, or a sub-verb such as `config diff`. Without `all` its rare options are left out.
std::string help_of_verb(const std::string& name, const std::string& meaning,
                         const OptionList& list, const std::vector<std::string>& examples, bool all,
                         std::size_t width);

}  // namespace gs
