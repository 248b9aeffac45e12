// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/colmap_verdict.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <set>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/reconstruct/colmap_log.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr int kFewFeatures = 200;          // in a photo: hardly enough to match it
constexpr int kNeededPoints = 30;          // to place a photo; COLMAP's abs_pose_min_num_inliers
constexpr std::size_t kMissingShown = 20;  // names in the verdict

double mean_error_of(const ColmapModel& model) {
  double sum = 0;
  for (const ColmapPoint& point : model.points) sum += point.error;
  return model.points.empty() ? 0 : sum / double(model.points.size());
}

/// Why photos are missing from the largest model: worked out from the log and the other models.
class Reasons {
 public:
  Reasons(const SceneFiles& files, const ColmapModel& largest)
      : log_(read_colmap_log(files.log())) {
    for (std::size_t i = 0; i < log_.photos.size(); ++i)
      ids_[log_.photos[i].name] = std::uint32_t(i + 1);
    for (const ColmapImage& image : largest.images)
      if (const auto id = ids_.find(image.name); id != ids_.end() && id->second != image.id)
        log_.seen_points.clear();  // COLMAP numbered the photos in another way
    for (const fs::path& folder : colmap_models_in(files.sparse()))
      if (folder != largest.folder)
        for (const ColmapImage& image : read_colmap_model(folder).images)
          other_models_.emplace(image.name, "sparse/" + folder.filename().string());
  }

  std::string of(const std::string& name) const {
    if (const auto other = other_models_.find(name); other != other_models_.end())
      return fmt::format("it is in another model, {}, which shares too little with the largest one",
                         other->second);
    const auto id = ids_.find(name);
    if (id == ids_.end()) return "COLMAP found no features in it, or could not read it";
    const int features = log_.photos[id->second - 1].features;
    if (features < kFewFeatures)
      return fmt::format("too few features ({}): blurred, dark or without texture", features);
    const auto seen = log_.seen_points.find(id->second);
    if (seen == log_.seen_points.end())
      return fmt::format("too few matches with the placed photos ({} features)", features);
    return fmt::format("{} of the model's points seen, {}", seen->second,
                       seen->second < kNeededPoints
                           ? fmt::format("{} are needed: too little overlap", kNeededPoints)
                           : "but no pose fits them: repeated patterns, or things that moved");
  }

 private:
  ColmapLog log_;
  std::map<std::string, std::uint32_t> ids_;
  std::map<std::string, std::string> other_models_;
};

}  // namespace

Reconstruction verdict_of(const ColmapPlan& plan) {
  const ColmapModel model = read_colmap_model(plan.files.sparse() / "0");
  const Reasons reasons(plan.files, model);
  std::set<std::string> registered;
  for (const ColmapImage& image : model.images) registered.insert(image.name);
  Reconstruction result;
  result.scene = plan.files.root;
  result.photos = plan.photos.size();
  result.registered = model.images.size();
  result.points = model.points.size();
  result.models = colmap_models_in(plan.files.sparse()).size();
  result.mean_error = mean_error_of(model);
  for (const PhotoFile& photo : plan.photos)
    if (!registered.contains(photo.name))
      result.missing.push_back({photo.name, plan.has_panoramas()
                                                ? "none of its views was placed: too little overlap"
                                                : reasons.of(photo.name)});
  return result;
}

std::string describe(const Reconstruction& result) {
  std::string lines =
      fmt::format("{} of {} photos placed, {} points, mean reprojection error {:.2f} pixels\n",
                  result.registered, result.photos, result.points, result.mean_error);
  if (result.models > 1)
    lines +=
        fmt::format("{} models that do not fit together; the largest is sparse/0\n", result.models);
  const std::size_t shown = std::min(result.missing.size(), kMissingShown);
  for (std::size_t i = 0; i < shown; ++i)
    lines += fmt::format("missing: {}: {}\n", printable(result.missing[i].name),
                         printable(result.missing[i].reason));
  if (shown < result.missing.size())
    lines += fmt::format("missing: {} more\n", result.missing.size() - shown);
  return lines;
}

}  // namespace gs
