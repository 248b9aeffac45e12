// SPDX-License-Identifier: Apache-2.0
// What gemsplat.train() and gemsplat.Trainer share.
#pragma once

#include <string>

#include "apps/python/module.h"
#include "gs_app/jobs/keywords.h"
#include "gs_train/loop/trainer.h"

namespace gs::python {

/// The settings of a run: keywords of the verb train over `config`, as apply_settings() takes it,
/// over a start. A loaded scene, which may be null, brings its own [dataset].
Config config_of_run(const ScenePointer& scene, const std::string& config,
                     const FilledVerb& keywords, Config start = {});

/// The model after the steps so far, against the test views.
Evaluation evaluation_of(Trainer& trainer, Lpips* lpips);

}  // namespace gs::python
