// SPDX-License-Identifier: Apache-2.0
// The part of an examination that looks at maps of depth and of normals.
#include <spdlog/fmt/fmt.h>

#include "data_loaders/doctor/examination.h"
#include "data_loaders/photos/map_file.h"
#include "data_loaders/photos/photo_fit.h"
#include "data_loaders/scene/depth/depth_kind_of.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"

namespace gs {
namespace {

using Level = Finding::Level;

constexpr int kFewBits = 8;  // 256 depths

/// Maps that cannot be read, or have another shape than their photo. `read` returns the size of one,
/// and `instead` is how to train without.
template <class Read>
void report_faults(const CompanionKind& kind, const char* instead, Read&& read,
                   Examination& examination) {
  std::vector<std::size_t> unreadable, other;
  std::string first_fault;
  for (const std::size_t i : examination.usable) {
    const Photo& photo = examination.scene.photos[i];
    if ((photo.*kind.file).empty()) continue;
    try {
      if (!has_shape_of(read(i, photo.*kind.file), photo.size)) other.push_back(i);
    } catch (const Error& error) {
      if (unreadable.empty()) first_fault = error.what();
      unreadable.push_back(i);
    }
  }
  if (!unreadable.empty())
    examination.add(Level::fatal, kind.folder,
                    fmt::format("{} of {} cannot be read: {}", unreadable.size(),
                                counted(examination.scene.photos.size(), kind.noun), first_fault),
                    examination.names_of(unreadable));
  if (!other.empty())
    examination.add(
        Level::fatal, kind.folder,
        fmt::format("{} another shape than the photo; make the maps again from these photos, or "
                    "train without them ({})",
                    counted(other.size(), kind.noun, "has", "have"), instead),
        examination.names_of(other));
}

/// Depth maps with faults, and coarse ones.
void report_depth_faults(Examination& examination) {
  std::vector<std::size_t> coarse;
  const auto read = [&](std::size_t i, const std::filesystem::path& path) -> PhotoSize {
    const MapFile depth = read_depth_file(path);
    if (depth.has_steps && depth.bits <= kFewBits) coarse.push_back(i);
    return {depth.values.width, depth.values.height};
  };
  report_faults(kDepthMaps, "--set dataset.depth=none", read, examination);
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
  if (!match_files_of(kDepthMaps, Level::note, "; only the photo is trained on", examination))
    return;
  if (examination.config.loss.depth_weight == 0)
    examination.add(Level::note, "depth",
                    "loss.depth_weight is 0: the maps are only measured against, not trained on");
  if (!look_at_maps) return;
  report_depth_faults(examination);
  if (examination.diagnosis.can_train()) report_kind(examination);
}

void examine_normals(Examination& examination, bool look_at_maps) {
  const DatasetConfig& dataset = examination.config.dataset;
  if (!(examination.config.surface.prior_weight > 0)) {
    const bool are_there = dataset.normals.empty() &&
                           is_folder(std::filesystem::path(dataset.source) / kNormalMaps.folder);
    if (are_there)
      examination.add(Level::note, kNormalMaps.folder,
                      "surface.prior_weight is 0: the normal maps there are not trained on");
    return;
  }
  if (!match_files_of(kNormalMaps, Level::note, "; it trains without", examination) ||
      !look_at_maps)
    return;
  const auto read = [](std::size_t, const std::filesystem::path& path) -> PhotoSize {
    const ImageF normals = read_normal_file(path);
    return {normals.width, normals.height};
  };
  report_faults(kNormalMaps, "--set surface.prior_weight=0", read, examination);
}

}  // namespace gs
