// SPDX-License-Identifier: Apache-2.0
// A backend whose score passes render nothing: they give the sums of a test, and note what was asked.
#pragma once

#include <vector>

#include "gs_train/stages/scalar_backend.h"

namespace gs {

class ScoringBackend final : public ScalarBackend {
 public:
  void score_photos(TrainingModel& model, Span<const TrainingPhoto> asked,
                    const PixelRule& by) override {
    for (const TrainingPhoto& photo : asked) photos.push_back(photo.photo_row);
    rule = by;
    begin_sums(model);
    if (!sums.empty()) model.statistics.sums.upload(sums);
  }

  std::vector<FragmentSums> sums;   // that every pass gives; empty: zeros
  std::vector<std::size_t> photos;  // rows of all that were asked for
  PixelRule rule;                   // of the last pass
};

}  // namespace gs
