// SPDX-License-Identifier: Apache-2.0
// The part of an examination that looks at depth maps.
#include <spdlog/fmt/fmt.h>

#include "data_loaders/doctor/examination.h"
#include "data_loaders/photos/depth_file.h"
#include "data_loaders/photos/photo_fit.h"
#include "data_loaders/scene/depth/depth_kind_of.h"
#include "gs_core/error.h"

namespace gs {
namespace {

using Level = Finding::Level;

constexpr int kFewBits = 8;  // 256 depths

/// Maps that cannot be read, or have another shape than their photo.
void report_faults(Examination& examination) {
  std::vector<std::size_t> unreadable, other, coarse;
  std::string first_fault;
  for (const std::size_t i : examination.usable) {
    const Photo& photo = examination.scene.photos[i];
    if (photo.depth_file.empty()) continue;
    try {
      const DepthFile depth = read_depth_file(photo.depth_file);
      if (depth.has_steps && depth.bits <= kFewBits) coarse.push_back(i);
      if (!has_shape_of({depth.values.width, depth.values.height}, photo.size)) other.push_back(i);
    } catch (const Error& error) {
      if (unreadable.empty()) first_fault = error.what();
      unreadable.push_back(i);
    }
  }
  if (!unreadable.empty())
    examination.add(Level::fatal, "depth",
                    fmt::format("{} of {} cannot be read: {}", unreadable.size(),
                                counted(examination.scene.photos.size(), "depth map"), first_fault),
                    examination.names_of(unreadable));
  if (!other.empty())
    examination.add(
        Level::fatal, "depth",
        fmt::format("{} another shape than the photo; make the maps again from these photos, or "
                    "train without them (--set dataset.depth=none)",
                    counted(other.size(), "depth map", "has", "have")),
        examination.names_of(other));
  if (!coarse.empty())
    examination.add(Level::note, "depth",
                    fmt::format("{} only 256 different depths (8 bits); 16 bits show smooth "
                                "surfaces without steps",
                                counted(coarse.size(), "depth map", "has", "have")),
                    examination.names_of(coarse));
}

/// What the maps hold by the sparse points, beside what dataset.depth_kind says.
void report_kind(Examination& examination) {
  DepthAgreement agreement;
  try {
    agreement = measure_depth_maps(examination.config.dataset);
  } catch (const Error&) {
    return;  // check_scene() says why
  }
  if (agreement.maps == 0) return;
  const DepthKind found = agreement.kind(), said = examination.config.dataset.depth_kind;
  const std::string by_points = fmt::format(
      "by the sparse points the depth maps hold {} (rank correlation with depth {:.2f} "
      "in {})",
      text_of(found), agreement.correlation, counted(agreement.maps, "map"));
  const bool is_inverse = found == DepthKind::inverse;
  if (found == DepthKind::automatic)
    examination.add(Level::warning, "depth",
                    by_points +
                        "; they may belong to other photos or cameras: look at them, or "
                        "train without them (--set dataset.depth=none)");
  else if (said != DepthKind::automatic && is_inverse != (said == DepthKind::inverse))
    examination.add(
        Level::warning, "depth",
        fmt::format("{}, but dataset.depth_kind is {}; maps of another kind are ignored "
                    "or mislead: set it to auto",
                    by_points, word_of(said)));
  else
    examination.add(Level::good, "depth", by_points);
}

}  // namespace

void examine_depth(Examination& examination, bool look_at_maps) {
  if (!match_files_of(kDepthMaps, "depth map", Level::note, "; only the photo is trained on",
                      examination))
    return;
  if (examination.config.loss.depth_weight == 0)
    examination.add(Level::note, "depth",
                    "loss.depth_weight is 0: the maps are only measured against, not trained on");
  if (!look_at_maps) return;
  report_faults(examination);
  if (examination.diagnosis.can_train()) report_kind(examination);
}

}  // namespace gs
