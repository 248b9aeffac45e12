// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/take_pictures.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>

#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "gs_core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// How many of `frames` come from a video that has `own` of the `all` frames of all videos.
std::int64_t share_of(std::int64_t own, std::int64_t all, int frames) {
  return std::max<std::int64_t>(1, (own * frames + all / 2) / all);
}

// Names for the frames of each video: its own name without the ending, or with it where two videos
// would have the same.
std::vector<std::string> stems_of(const std::vector<fs::path>& videos) {
  std::map<std::string, int> counts;
  for (const fs::path& video : videos) ++counts[video.stem().string()];
  std::vector<std::string> stems;
  for (const fs::path& video : videos)
    stems.push_back(counts[video.stem().string()] == 1 ? video.stem().string()
                                                       : video.filename().string());
  return stems;
}

}  // namespace

void take_photos(const ColmapPlan& plan) {
  if (plan.photos_in_place) return;
  for (const PhotoFile& photo : plan.photos) {
    const fs::path target = plan.files.images() / photo.name;
    if (fs::exists(target)) continue;
    std::error_code error;
    fs::create_directories(target.parent_path(), error);
    const fs::path source = fs::canonical(photo.path);
    fs::create_hard_link(source, target, error);
    if (error) fs::copy_file(source, target, error);
    if (error)
      throw Error(
          fmt::format("cannot copy {} to {}: {}; free some space or choose another folder "
                      "with -o",
                      source.string(), target.string(), error.message()));
  }
}

void take_frames_of_videos(ColmapPlan& plan, SceneState& state, const ColmapProgress& progress) {
  const std::vector<std::string> stems = stems_of(plan.videos);
  const auto name_of = [&](std::size_t i) { return "frames of " + stems[i]; };
  std::vector<std::int64_t> counts;
  std::int64_t all = 0, before = 0;
  for (const fs::path& video : plan.videos) all += counts.emplace_back(count_frames(video));
  for (std::size_t i = 0; i < plan.videos.size(); before += counts[i++]) {
    if (state.complete.contains(name_of(i))) continue;
    progress(ColmapStage::frames, before, all);
    const std::int64_t wanted = share_of(counts[i], all, plan.frames);
    log_info("the sharpest {} of {} frames of {}", std::min(wanted, counts[i]), counts[i],
             plan.videos[i].string());
    take_frames(plan.videos[i], counts[i], wanted, plan.files.images(), stems[i],
                [&](std::int64_t done) { progress(ColmapStage::frames, before + done, all); });
    state.complete.insert(name_of(i));
    write_state(plan.files, state);
  }
  plan.photos = find_photos(plan.files.images(), {});
  complete_plan(plan, plan.videos[0].parent_path());
}

}  // namespace gs
