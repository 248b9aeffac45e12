// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/evaluate_run.h"

namespace gs {

std::optional<SceneLooks> looks_of(Trainer& trainer) {
  const PhotometricState& state = trainer.model().photometric;
  if (state.empty()) return std::nullopt;
  return looks_of(trainer.config().photometric, state, trainer.scene());
}

EvaluationOptions evaluation_options(Trainer& trainer, MetricSet metrics) {
  EvaluationOptions options(metrics);
  options.is_corrected = trainer.config().eval.color_corrected;
  const std::optional<SceneLooks> looks = looks_of(trainer);
  if (!looks) return options;
  options.appearance_of = appearances(*looks);
  options.solved_appearance_of = solved_appearances(*looks, trainer.scene());
  options.is_corrected = true;
  return options;
}

}  // namespace gs
