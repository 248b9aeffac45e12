// SPDX-License-Identifier: Apache-2.0
// The program of a rank that is a process and not rank 0.
#pragma once

#include "gs_app/ranks/rank_place.h"
#include "gs_core/error.h"

namespace gs {

/// Connects to rank 0, loads its scene, and works for it until the run ends. Returns the exit code
/// of the process: rank 0 has said what went wrong. Throws Error where it cannot be reached.
ExitCode serve_rank(const RankPlace& place);

}  // namespace gs
