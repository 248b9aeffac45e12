// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/refine/tracks.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/error.h"

namespace gs {

bool has_tracks(const ColmapModel& model) {
  return std::ranges::any_of(model.images,
                             [](const ColmapImage& image) { return !image.observations.empty(); });
}

std::vector<std::vector<SeenPoint>> seen_points(const ColmapModel& model,
                                                const std::string& option) {
  std::vector<std::vector<SeenPoint>> seen(model.images.size());
  bool has_any = false;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    for (const ColmapObservation& observation : model.images[i].observations) {
      const auto point =
          std::lower_bound(model.points.begin(), model.points.end(), observation.point_id,
                           [](const ColmapPoint& a, std::uint64_t id) { return a.id < id; });
      if (point != model.points.end() && point->id == observation.point_id)
        seen[i].push_back(
            {std::uint32_t(point - model.points.begin()), {observation.x, observation.y}});
    }
    has_any = has_any || !seen[i].empty();
  }
  if (has_any) return seen;
  throw Error(
      fmt::format("the model in {} does not say which photos show which points (as POINTS2D of "
                  "COLMAP's images file does), and "
                  "{} needs that; name COLMAP's own model with --set dataset.model=FOLDER, run "
                  "`gemsplat reconstruct` on the photos, or "
                  "leave {} out",
                  model.folder.string(), option, option));
}

}  // namespace gs
