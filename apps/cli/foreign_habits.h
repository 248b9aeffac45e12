// SPDX-License-Identifier: Apache-2.0
// Habits of users of other trainers and of older versions: `eval -m RUN`, --start_checkpoint, prune.
// Flags that mean the same here are options of the verbs (gs_app/jobs/parts/foreign_flags.h).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "gs_app/jobs/parts/job.h"

namespace gs {

/// Rewrites habits that are no settings: `help VERB` becomes `VERB --help`, and `eval -m RUN`
/// becomes `eval RUN`. A folder or film in place of a verb is trained on and shown. `arguments` are
/// those of normalized_arguments().
std::vector<std::string> without_foreign_habits(std::vector<std::string> arguments,
                                                const std::vector<Verb>& verbs);

/// What to use instead of another trainer's flag, or of a verb of an older version: "--resume PATH"
/// for --start-checkpoint of `train`. Empty if the table does not have it.
std::string own_flag(std::string_view verb, std::string_view argument);

}  // namespace gs
