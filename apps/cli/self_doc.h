// SPDX-License-Identifier: Apache-2.0
// gemsplat self-doc FOLDER: man pages and completions, made from the lists of options. The build
// calls it; --help does not list it. `gemsplat self-doc ~/.local/share` serves one user, and
// `gemsplat self-doc --markdown` prints docs/reference/commands.md.
#pragma once

#include <vector>

#include "gs_app/jobs/parts/job.h"

namespace CLI {
class App;
}

namespace gs {

void add_self_doc(CLI::App& program, const std::vector<Verb>& verbs);

}  // namespace gs
