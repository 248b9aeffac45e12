// SPDX-License-Identifier: Apache-2.0
// Stage 8 for the numbers of a photometric model: Adam for all photos, also those that the
// step did not show. Their moments move them on.
#include "gs_core/error.h"
#include "gs_core/math/update/adam.h"
#include "gs_render/stage_clock.h"
#include "gs_train/photometric/photometric_start.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {

void update_photometric(PhotometricState& state, const PhotometricModel& model, float rate,
                        const AdamRule& rule, std::vector<double>& gradient) {
  const HostStage stage("photometric");
  GS_CHECK(gradient.size() == state.values.size());
  model.add_penalties(state, gradient);
  const AdamStep step = adam_step(state.adam_steps += rule.steps, rate);
  for (std::size_t i = 0; i < gradient.size(); ++i)
    adam_update(state.values[i], state.moments[i], float(gradient[i]), step, rule);
  center_photos(model, state);
}

}  // namespace gs
