// SPDX-License-Identifier: Apache-2.0
// The verbs of gemsplat. verbs.cpp has their list; each one is a file of this folder.
#pragma once

#include <vector>

#include "gs_app/jobs/parts/job.h"

// A row for each verb, in the order of --help. `eval` is eval.cpp, which defines eval_verb().
#define GS_VERBS(row)                                                                      \
  row(studio) row(train) row(reconstruct) row(partition) row(view) row(render) row(report) \
      row(edit) row(export) row(mesh) row(undistort) row(georef) row(eval) row(mesh_error) \
          row(experiment) row(bench) row(doctor) row(info) row(config) row(selftest)

namespace gs {

#define GS_DECLARE_VERB(name) Verb name##_verb();
GS_VERBS(GS_DECLARE_VERB)
#undef GS_DECLARE_VERB

/// All of them.
std::vector<Verb> verbs();

}  // namespace gs
