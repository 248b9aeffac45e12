// SPDX-License-Identifier: Apache-2.0
// The part of an examination that compares the colors of points between photos.
#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/doctor/examination.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/scene/photo_light.h"
#include "gs_core/error.h"

namespace gs {

namespace {

/// What EXIF says of the photos' exposures, as the end of a message; empty if it says nothing.
std::string exif_of(const Examination& examination) {
  float least = 0, most = 0;
  std::size_t known = 0;
  const auto& photos = examination.scene.photos;
  for (const Photo& photo : photos) {
    const std::optional<float> stops = read_exposure_stops(photo.file);
    if (!stops) continue;
    least = known ? std::min(least, *stops) : *stops;
    most = known ? std::max(most, *stops) : *stops;
    ++known;
  }
  if (known == 0) return {};
  return fmt::format(
      "; by EXIF, the exposures of {} differ by {:.1f} stops, from which gains start "
      "without --exposure",
      known == photos.size() ? counted(known, "photo")
                             : fmt::format("{} of {} photos", known, photos.size()),
      most - least);
}

}  // namespace

// Nothing here keeps a run from starting, so that an Error is a reason why light is not known.
// Single frames of videos take long to decode.
void examine_light(Examination& examination) {
  if (!examination.diagnosis.can_train()) return;
  const DatasetConfig& dataset = examination.config.dataset;
  std::optional<ExposureSummary> exposure;
  std::string unknown_because, by_exif;
  const bool has_frames = std::ranges::any_of(examination.scene.photos, &Photo::is_frame);
  try {
    unknown_because =
        has_frames ? "frames of videos are not looked at" : why_exposures_are_unknown(dataset);
    if (!has_frames) by_exif = exif_of(examination);
    if (unknown_because.empty()) exposure = measure_light(dataset);
  } catch (const Error& error) {
    unknown_because = error.what();
  }
  const PhotometricChoice choice = choose_photometric(exposure, unknown_because);
  if (choice.has_gains)
    examination.add(Finding::Level::note, "light",
                    choice.why +
                        "; to learn gains of each photo, add --exposure --set "
                        "photometric.model=gains" +
                        by_exif);
  else
    examination.add(exposure ? Finding::Level::good : Finding::Level::note, "light",
                    choice.why + by_exif);
}

}  // namespace gs
