// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/take_pictures.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <optional>

#include "data_loaders/counted.h"
#include "data_loaders/photos/orientation.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"

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

constexpr std::string_view kImages = "images/";

std::string name_in_scene(const std::string& photo) { return std::string(kImages) + photo; }

void place(const std::map<std::string, fs::path>& sources, SceneFolder& folder) {
  folder.files().place(sources, [&] { return folder.work(); });
}

// The photo upright; nothing where it is damaged, which a warning says.
std::optional<Image8> upright_of(const PhotoFile& photo) {
  try {
    return read_upright(photo.path);
  } catch (const AccessError&) {
    throw;
  } catch (const Error& error) {
    if (error.code() == ExitCode::out_of_memory) throw;
    log_warning("a photo is left out: {}", error.what());
    return {};
  }
}

// Upright copies in the work folder, by their names in the scene.
std::map<std::string, fs::path> make_copies(const std::vector<PhotoFile>& photos,
                                            SceneFolder& folder, const ColmapProgress& progress) {
  if (photos.empty()) return {};
  log_info("{} copied upright into the scene", counted(photos.size(), "photo", "is", "are"));
  const fs::path copies = folder.work() / "copies";
  const auto count = std::int64_t(photos.size());
  progress(ColmapStage::copies, 0, count);
  std::map<std::string, fs::path> made;
  std::mutex mutex;
  std::int64_t done = 0;
  parallel_for(photos.size(), 1, [&](std::size_t i) {
    const PhotoFile& photo = photos[i];
    const fs::path copy = copies / (std::to_string(i) + fs::path(photo.name).extension().string());
    const std::optional<Image8> pixels = upright_of(photo);
    if (pixels) write_copy(photo.path, *pixels, copy);
    const std::lock_guard lock(mutex);
    if (pixels) made[name_in_scene(photo.name)] = copy;
    progress(ColmapStage::copies, ++done, count);
  });
  return made;
}

// The frames are made in the work folder and moved when all of a video are there.
void take_frames_of(const fs::path& video, std::int64_t count, std::int64_t wanted,
                    const std::string& stem, SceneFolder& folder,
                    const std::function<void(std::int64_t done)>& progress) {
  const fs::path frames = folder.work() / "frames";
  std::map<std::string, fs::path> sources;
  for (const std::string& name : take_frames(video, count, wanted, frames, stem, progress))
    sources[name_in_scene(name)] = frames / name;
  place(sources, folder);
}

// Frames that we took, and no other pictures in the folder. A scene of gemsplat 0.1.0 does not say
// which these are.
std::vector<PhotoFile> frames_in(const ColmapPlan& plan, SceneFolder& folder) {
  std::vector<PhotoFile> photos = find_photos(plan.files.images(), {}, PhotoUse::in_place);
  const OwnedFiles::Stamps& ours = folder.files().names();
  const auto first = ours.lower_bound(std::string(kImages));
  if (first == ours.end() || !first->first.starts_with(kImages)) return photos;
  std::erase_if(photos,
                [&](const PhotoFile& photo) { return !ours.contains(name_in_scene(photo.name)); });
  return photos;
}

}  // namespace

void take_photos(ColmapPlan& plan, SceneFolder& folder, const ColmapProgress& progress) {
  if (plan.photos_in_place) return;
  std::map<std::string, fs::path> sources;
  std::vector<PhotoFile> to_copy;
  for (const PhotoFile& photo : plan.photos)
    if (!photo.is_copied)
      sources[name_in_scene(photo.name)] = fs::canonical(photo.path);
    else if (!folder.files().holds(name_in_scene(photo.name)))
      to_copy.push_back(photo);
  const std::map<std::string, fs::path> copies = make_copies(to_copy, folder, progress);
  sources.insert(copies.begin(), copies.end());
  place(sources, folder);
  std::erase_if(plan.photos, [&](const PhotoFile& photo) {
    return photo.is_copied && !folder.files().holds(name_in_scene(photo.name));
  });
  if (!to_copy.empty()) complete_plan(plan, plan.files.root);
}

std::string words_on_frames(std::int64_t wanted, std::int64_t count, const std::string& video) {
  if (wanted < count)
    return fmt::format("the sharpest {} of {} frames of {}", wanted, count, video);
  return fmt::format(
      "all {} frames of {}, blurred ones, too; where neighbors show nearly the same, --frames {} "
      "takes the sharpest of each four",
      count, video, std::max<std::int64_t>(count / 4, 3));
}

void take_frames_of_videos(ColmapPlan& plan, SceneFolder& folder, const ColmapProgress& progress) {
  const std::vector<std::string> stems = stems_of(plan.videos);
  const auto name_of = [&](std::size_t i) { return "frames of " + stems[i]; };
  std::vector<std::int64_t> counts;
  std::int64_t all = 0, before = 0;
  for (const fs::path& video : plan.videos) all += counts.emplace_back(count_frames(video));
  for (std::size_t i = 0; i < plan.videos.size(); before += counts[i++]) {
    if (folder.has(name_of(i))) continue;
    progress(ColmapStage::frames, before, all);
    const std::int64_t wanted = share_of(counts[i], all, plan.frames);
    log_info("{}", words_on_frames(wanted, counts[i], plan.videos[i].string()));
    take_frames_of(plan.videos[i], counts[i], wanted, stems[i], folder,
                   [&](std::int64_t done) { progress(ColmapStage::frames, before + done, all); });
    folder.complete(name_of(i));
  }
  plan.photos = frames_in(plan, folder);
  complete_plan(plan, plan.videos[0].parent_path());
}

}  // namespace gs
