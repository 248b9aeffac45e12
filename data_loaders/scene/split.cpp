// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/split.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <unordered_map>

#include "gs_core/error.h"
#include "gs_core/log.h"

namespace gs {
namespace {

/// The frame of each image, numbered in the order in which the images come to them.
std::vector<std::size_t> frame_numbers(const ColmapModel& model) {
  std::unordered_map<std::uint64_t, std::size_t> frame_of_image;  // index in model.frames
  for (std::size_t frame = 0; frame < model.frames.size(); ++frame)
    for (std::uint64_t image : model.frames[frame].image_ids) frame_of_image[image] = frame;

  std::unordered_map<std::size_t, std::size_t> number_of_frame;
  std::vector<std::size_t> numbers;
  std::size_t next = 0;
  for (const ColmapImage& image : model.images) {
    const auto frame = frame_of_image.find(image.id);
    const bool is_new =
        frame == frame_of_image.end() || number_of_frame.try_emplace(frame->second, next).second;
    numbers.push_back(is_new ? next++ : number_of_frame.at(frame->second));
  }
  return numbers;
}

}  // namespace

std::vector<bool> test_views_of(const DatasetConfig& dataset, const ColmapModel& model) {
  if (model.images.empty())
    throw Error(fmt::format(
        "the model in {} has no images; run COLMAP again or name another model with --set "
        "dataset.model=FOLDER",
        model.folder.string()));
  std::vector<bool> is_test(model.images.size(), false);
  if (!dataset.eval) return is_test;
  if (dataset.test_every < 1)
    throw UsageError(fmt::format("dataset.test_every is {}; give 2 or more", dataset.test_every));

  const std::vector<std::size_t> numbers = frame_numbers(model);
  for (std::size_t i = 0; i < is_test.size(); ++i)
    is_test[i] = numbers[i] % std::size_t(dataset.test_every) == 0;

  const std::size_t frames = 1 + *std::max_element(numbers.begin(), numbers.end());
  const bool has_rigs = frames < numbers.size();
  if (std::find(is_test.begin(), is_test.end(), false) == is_test.end())
    throw UsageError(
        fmt::format("no view is left to train on: dataset.eval holds out every {}th of {}{}; raise "
                    "dataset.test_every, or train without dataset.eval",
                    dataset.test_every, frames, has_rigs ? " rig frames" : ""));
  if (has_rigs)
    log_info("{} photos in {} rig frames: test views are held out by whole frames", numbers.size(),
             frames);
  return is_test;
}

}  // namespace gs
