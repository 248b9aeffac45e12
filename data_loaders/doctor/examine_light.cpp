// SPDX-License-Identifier: Apache-2.0
// The part of an examination that compares the colors of points between photos.
#include <algorithm>

#include "data_loaders/doctor/examination.h"
#include "data_loaders/scene/photo_light.h"
#include "gs_core/error.h"

namespace gs {

// Nothing here keeps a run from starting, so that an Error is a reason why light is not known.
// Single frames of videos take long to decode.
void examine_light(Examination& examination) {
  if (!examination.diagnosis.can_train()) return;
  const DatasetConfig& dataset = examination.config.dataset;
  std::optional<ExposureSummary> exposure;
  std::string unknown_because;
  const std::vector<ColmapImage>& images = examination.model().images;
  const bool has_frames = std::any_of(
      images.begin(), images.end(), [](const ColmapImage& image) { return !image.video.empty(); });
  try {
    unknown_because =
        has_frames ? "frames of videos are not looked at" : why_exposures_are_unknown(dataset);
    if (unknown_because.empty()) exposure = measure_light(dataset);
  } catch (const Error& error) {
    unknown_because = error.what();
  }
  const PhotometricChoice choice = choose_photometric(exposure, unknown_because);
  if (choice.has_gains)
    examination.add(Finding::Level::note, "light",
                    choice.why +
                        "; to learn gains of each photo, add --exposure --set "
                        "photometric.model=gains");
  else
    examination.add(exposure ? Finding::Level::good : Finding::Level::note, "light", choice.why);
}

}  // namespace gs
