// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/take_pictures.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <optional>

#include "data_loaders/counted.h"
#include "data_loaders/photos/orientation.h"
#include "data_loaders/video/sharpest_frames.h"
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

// Gives `to` the content of `from`, by a hard link or, where the file system has none, by a copy.
void place(const fs::path& from, const fs::path& to, const fs::path& work) {
  std::error_code error;
  if (fs::exists(to, error)) return;
  fs::create_directories(to.parent_path(), error);
  if (!error) fs::create_hard_link(from, to, error);
  if (!error) return;
  const fs::path copy = work / "copy";
  if (fs::copy_file(from, copy, fs::copy_options::overwrite_existing, error))
    fs::rename(copy, to, error);
  if (error)
    throw Error(
        fmt::format("cannot copy {} to {}: {}; free some space or choose another folder with -o",
                    from.string(), to.string(), error.message()));
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

void make_copies(const std::vector<PhotoFile>& photos, const fs::path& images,
                 const ColmapProgress& progress) {
  if (photos.empty()) return;
  log_info("{} copied upright into the scene", counted(photos.size(), "photo", "is", "are"));
  const auto count = std::int64_t(photos.size());
  progress(ColmapStage::copies, 0, count);
  std::mutex mutex;
  std::int64_t done = 0;
  parallel_for(photos.size(), 1, [&](std::size_t i) {
    const std::optional<Image8> pixels = upright_of(photos[i]);
    if (pixels) write_copy(photos[i].path, *pixels, images / photos[i].name);
    const std::lock_guard lock(mutex);
    progress(ColmapStage::copies, ++done, count);
  });
}

// Frames of these videos, and no pictures that the user has put beside them.
std::vector<PhotoFile> frames_in(const fs::path& folder, const std::vector<std::string>& stems) {
  std::vector<PhotoFile> photos = find_photos(folder, {}, PhotoUse::in_place);
  std::erase_if(photos, [&](const PhotoFile& photo) {
    return std::ranges::none_of(
        stems, [&](const std::string& stem) { return photo.name.starts_with(stem + "_"); });
  });
  return photos;
}

}  // namespace

void take_photos(ColmapPlan& plan, SceneFolder& folder, const ColmapProgress& progress) {
  const fs::path images = plan.files.new_images();
  if (plan.photos_in_place) fs::remove_all(images);  // of an earlier command that brought them
  if (plan.photos_in_place || (folder.has("features") && !fs::exists(images))) return;
  std::vector<PhotoFile> to_copy;
  for (const PhotoFile& photo : plan.photos)
    if (!photo.is_copied)
      place(fs::canonical(photo.path), images / photo.name, plan.files.work);
    else if (!fs::exists(images / photo.name))
      to_copy.push_back(photo);
  make_copies(to_copy, images, progress);
  std::erase_if(plan.photos, [&](const PhotoFile& photo) {
    return photo.is_copied && !fs::exists(images / photo.name);
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
    take_frames(plan.videos[i], counts[i], wanted, plan.files.new_images(), stems[i],
                [&](std::int64_t done) { progress(ColmapStage::frames, before + done, all); });
    folder.complete(name_of(i));
  }
  plan.photos = frames_in(plan.files.photos(), stems);
  complete_plan(plan, plan.videos[0].parent_path());
}

}  // namespace gs
