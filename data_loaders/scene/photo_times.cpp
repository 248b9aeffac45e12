// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/photo_times.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <optional>
#include <set>

#include "data_loaders/photos/photo_names.h"
#include "gs_core/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostDigits = 15;  // of a number in a name; a double holds it exactly

bool is_folder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

// The folder with the frames of the camera that an image stands for, relative to `images`; empty if
// there is none.
std::string folder_of_frames(const fs::path& images, const std::string& image) {
  const std::string stem = without_extension(image);
  if (is_folder(images / stem)) return stem;
  return fs::path(image).parent_path().generic_string();
}

std::vector<std::string> frames_of(const fs::path& images, const ColmapImage& image) {
  const std::string folder = folder_of_frames(images, image.name);
  std::vector<std::string> names;
  if (!folder.empty()) names = picture_names_in(images / folder);
  if (names.empty())
    throw Error(fmt::format(
        "the camera of {} has no frames (dataset.times = \"frames\"): put them into the folder {}, "
        "for example with `ffmpeg -i VIDEO {}/%05d.png`",
        image.name, (images / without_extension(image.name)).string(),
        (images / without_extension(image.name)).string()));
  for (std::string& name : names) name = folder + "/" + name;
  return names;
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

}  // namespace

std::size_t add_frames_of_cameras(const fs::path& images, ColmapModel& model,
                                  std::vector<bool>& is_test) {
  std::vector<ColmapImage> all;
  std::vector<bool> all_test;
  std::set<std::string> folders;
  std::size_t frames_each = 0;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const ColmapImage& camera = model.images[i];
    const std::vector<std::string> names = frames_of(images, camera);
    if (!folders.insert(fs::path(names[0]).parent_path().generic_string()).second)
      throw Error(fmt::format(
          "several images of the model lie in the folder of {}: with dataset.times = \"frames\" "
          "the "
          "model has one image of each camera; a camera that moves has dataset.times = \"names\"",
          names[0]));
    if (i == 0) frames_each = names.size();
    check_same_count(model.images[0], frames_each, camera, names.size());
    for (std::size_t frame = 0; frame < names.size(); ++frame) {
      ColmapImage image = camera;
      image.id = std::uint32_t(all.size() + 1);
      image.name = names[frame];
      image.time = frames_each > 1 ? double(frame) / double(frames_each - 1) : 0.0;
      image.observations.clear();
      all.push_back(std::move(image));
      all_test.push_back(is_test[i]);
    }
  }
  model.images = std::move(all);
  model.rigs.clear();  // they name the images of before
  model.frames.clear();
  is_test = std::move(all_test);
  return frames_each;
}

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

}  // namespace gs
