// SPDX-License-Identifier: Apache-2.0
// A verb on the command line: its flags, and how its outcome and progress are shown.
#pragma once

#include <memory>
#include <string>

#include "gs_app/jobs/parts/job.h"

namespace CLI {
class App;
}

namespace gs {

struct BoundVerb {
  Verb verb;
  std::unique_ptr<VerbCall> call;
  CLI::App* app = nullptr;
  bool json = false;
  std::string progress = "bar";  // json, none
};

/// Whether --progress json has asked for lines of JSON on standard error, errors included.
bool writes_json_events();

/// --json and --progress, which every verb has.
void add_common_options(BoundVerb& bound);

/// Adds a verb to the program, with its own options and the common ones. Parsing it runs it, and
/// throws what it throws.
void add_verb(CLI::App& program, const Verb& verb);

}  // namespace gs
