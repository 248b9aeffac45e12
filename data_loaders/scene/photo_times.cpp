// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/photo_times.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <optional>
#include <set>

#include "data_loaders/photos/photo_names.h"
#include "data_loaders/video/film_frames.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostDigits = 15;  // of a number in a name; a double holds it exactly

constexpr std::int64_t kMostFrames = 1'000'000;  // of a video: nine hours

struct Frame {
  std::string name;
  fs::path video;  // empty: the frame is a picture of that name
  std::int64_t number = 0;
};

std::vector<Frame> frames_in_folder(const fs::path& images, const std::string& folder) {
  std::vector<Frame> frames;
  if (!folder.empty() && is_folder(images / folder))
    for (const std::string& name : picture_names_in(images / folder))
      frames.push_back({folder + "/" + name, {}, 0});
  return frames;
}

std::vector<Frame> frames_in_video(const fs::path& images, const std::string& camera) {
  std::vector<Frame> frames;
  const fs::path video = video_of_camera(images, camera);
  if (video.empty()) return frames;
  const std::int64_t count = count_frames(video);
  if (count > kMostFrames)
    throw Error(
        fmt::format("video {} has {} frames by its header, and more than {} are not read: it "
                    "is damaged, or has to be cut",
                    video.string(), count, kMostFrames));
  for (std::int64_t i = 0; i < count; ++i)
    frames.push_back({fmt::format("{}/{:05d}.png", camera, i + 1), video, i});
  return frames;
}

// The frames of the camera that an image stands for.
std::vector<Frame> frames_of(const fs::path& images, const ColmapImage& image) {
  const std::string camera = without_extension(image.name);
  const std::string folder = fs::path(image.name).parent_path().generic_string();
  std::vector<Frame> frames = frames_in_folder(images, camera);
  if (frames.empty()) frames = frames_in_video(images, camera);
  if (frames.empty()) frames = frames_in_folder(images, folder);
  if (frames.empty() && !folder.empty()) frames = frames_in_video(images, folder);
  if (frames.empty())
    throw Error(
        fmt::format("the camera of {} has no frames (dataset.times = \"frames\"): name its "
                    "video {}.mp4, or put its frames into the folder {}",
                    image.name, (images / camera).string(), (images / camera).string()));
  return frames;
}

void check_same_count(const ColmapImage& first, std::size_t expected, const ColmapImage& image,
                      std::size_t count) {
  if (count == expected) return;
  throw Error(fmt::format(
      "the camera of {} has {} frames, and that of {} has {}; frames of the same number "
      "must be of the same moment, so cut the films to the same length",
      image.name, count, first.name, expected));
}

// The last number in a name without its extension.
std::optional<double> number_in(const std::string& name) {
  const std::string stem = without_extension(name);
  const std::size_t last = stem.find_last_of("0123456789");
  if (last == stem.npos) return std::nullopt;
  const std::size_t before = stem.find_last_not_of("0123456789", last);
  const std::size_t begin = before == stem.npos ? 0 : before + 1;
  const std::string digits = stem.substr(begin, last + 1 - begin);
  if (digits.size() > kMostDigits) return std::nullopt;
  return std::stod(digits);
}

/// Each image becomes the frames of its camera. Returns the number of times.
std::size_t add_frames_of_cameras(SceneModel& scene) {
  std::vector<ColmapImage> images;
  std::vector<Photo> photos;
  std::set<std::string> sources;
  std::size_t frames_each = 0;
  for (std::size_t i = 0; i < scene.photos.size(); ++i) {
    const ColmapImage& camera = scene.model.images[i];
    const std::vector<Frame> frames = frames_of(scene.folders.images, camera);
    if (!sources.insert(fs::path(frames[0].name).parent_path().generic_string()).second)
      throw Error(fmt::format(
          "several images of the model lie in the folder of {}: with dataset.times = \"frames\" "
          "the model has one image of each camera; a camera that moves has dataset.times = "
          "\"names\"",
          frames[0].name));
    if (i == 0) frames_each = frames.size();
    check_same_count(scene.model.images[0], frames_each, camera, frames.size());
    for (std::size_t frame = 0; frame < frames.size(); ++frame) {
      ColmapImage& image = images.emplace_back(camera);
      image.id = std::uint32_t(images.size());
      image.name = frames[frame].name;
      image.time = frames_each > 1 ? double(frame) / double(frames_each - 1) : 0.0;
      image.observations.clear();
      Photo& photo = photos.emplace_back(scene.photos[i]);
      photo.name = image.name;
      photo.file = frames[frame].video;
      photo.is_frame = !photo.file.empty();
      photo.frame = frames[frame].number;
    }
  }
  scene.model.images = std::move(images);
  scene.photos = std::move(photos);
  scene.model.rigs.clear();  // they name the images of before
  scene.model.frames.clear();
  return frames_each;
}

/// Returns the number of different times.
std::size_t set_times_by_name(ColmapModel& model) {
  std::set<double> numbers;
  for (ColmapImage& image : model.images) {
    const std::optional<double> number = number_in(image.name);
    if (!number)
      throw Error(fmt::format(
          "the name {} has no number of a frame (dataset.times = \"names\"); rename the photos, as "
          "in frame_0012.png, or leave dataset.times out",
          image.name));
    numbers.insert(image.time = *number);
  }
  if (numbers.empty()) return 0;
  const double first = *numbers.begin(), duration = *numbers.rbegin() - first;
  for (ColmapImage& image : model.images)
    image.time = duration > 0 ? (image.time - first) / duration : 0.0;
  return numbers.size();
}

}  // namespace

fs::path video_of_camera(const fs::path& images, const std::string& camera) {
  const fs::path stem = images / camera;
  std::vector<fs::path> videos;
  std::error_code error;
  for (fs::directory_iterator entry(stem.parent_path(), error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path file = entry->path();
    std::error_code ignored;
    if (file.stem() == stem.filename() && is_video(file) && fs::is_regular_file(file, ignored))
      videos.push_back(file);
  }
  if (videos.size() > 1)
    throw Error(fmt::format("the camera {} has two videos, {} and {}; leave one there", camera,
                            std::min(videos[0], videos[1]).string(),
                            std::max(videos[0], videos[1]).filename().string()));
  return videos.empty() ? fs::path() : videos[0];
}

void find_times(const DatasetConfig& dataset, SceneModel& scene) {
  if (dataset.times == PhotoTimes::none) return;
  if (scene.folders.kind != SceneKind::colmap)
    throw UsageError(
        "dataset.times is for COLMAP models; the frames of a transforms.json have a `time` of "
        "their own");
  if (dataset.times == PhotoTimes::names) {
    scene.time_count = set_times_by_name(scene.model);
    return;
  }
  if (dataset.refine_cameras || dataset.exposure)
    throw UsageError(
        "dataset.times = \"frames\" goes neither with --refine-cameras nor with --exposure: the "
        "points were seen in one frame of each camera only; refine the scene before, without "
        "dataset.times");
  scene.time_count = add_frames_of_cameras(scene);
}

}  // namespace gs
