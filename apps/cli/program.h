// SPDX-License-Identifier: Apache-2.0
// gemsplat VERB: reads the command line, runs one verb, and tells the user what went wrong.
#pragma once

namespace gs {

/// What main() does. This is the only place that catches errors. Returns the exit code.
int run_program(int argc, const char* const* argv);

}  // namespace gs
