// SPDX-License-Identifier: Apache-2.0
// Stages, in order: parse, read each frame's name, camera and pose, split, read the points.
#include "data_loaders/transforms/transforms_json.h"

#include <spdlog/fmt/fmt.h>

#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <unordered_set>

#include "data_loaders/counted.h"
#include "data_loaders/transforms/transforms_file.h"
#include "data_loaders/transforms/transforms_frame.h"
#include "data_loaders/transforms/transforms_points.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Names = std::unordered_set<std::string>;

constexpr const char* kOneFile = "transforms.json";
constexpr const char* kTrainFile = "transforms_train.json";

/// Puts the frames of one or more files into a model, whose folder is set.
class FrameCollector {
 public:
  explicit FrameCollector(ColmapModel& model) : model_(model) {}

  void add_frames(const TransformsFile& file) {
    for (std::size_t i = 0; i < file.frames().size(); ++i) {
      const TransformsFrame frame(file, i);
      ColmapImage image;
      image.id = std::uint32_t(model_.images.size() + 1);
      image.name = frame.name();
      image.mask = frame.mask();
      image.depth = frame.depth();
      if (!names_.insert(image.name).second)
        file.fail(fmt::format(
            "file_path of frame {} is '{}', which an earlier frame has, too; leave one out", i,
            image.name));
      image.camera_id = id_of(frame.camera(image.name));
      frame.read_pose(image);
      if (const auto time = frame.time()) times_.insert(image.time = *time);
      model_.images.push_back(std::move(image));
    }
  }

  /// Different times at which photos were taken.
  std::size_t time_count() const { return times_.size(); }

  /// Times that leave 0 to 1 are moved and scaled, so that the first photo has 0 and the last 1.
  void normalize_times() {
    if (times_.empty() || (*times_.begin() >= 0 && *times_.rbegin() <= 1)) return;
    const double first = *times_.begin(), duration = *times_.rbegin() - first;
    for (ColmapImage& image : model_.images)
      image.time = duration > 0 ? (image.time - first) / duration : 0;
  }

 private:
  std::uint32_t id_of(ColmapCamera camera) {
    const auto [known, is_new] = ids_.try_emplace(
        {camera.model, camera.width, camera.height, camera.params}, ids_.size() + 1);
    camera.id = known->second;
    if (is_new) model_.cameras.emplace(camera.id, std::move(camera));
    return known->second;
  }

  ColmapModel& model_;
  Names names_;
  std::set<double> times_;
  std::map<std::tuple<CameraModel, int, int, std::vector<double>>, std::uint32_t> ids_;
};

/// The photos that a list at the top of the file names; nothing if there is no such list.
std::optional<Names> listed(const TransformsFile& file, const char* key, const Names& known) {
  const auto list = file.top.find(key);
  if (list == file.top.end() || list->is_null()) return std::nullopt;
  if (!list->is_array())
    file.fail(fmt::format("{} is not a list; list file_paths in it or leave it out", key));
  Names names;
  for (std::size_t i = 0; i < list->size(); ++i) {
    const SortedJson& entry = (*list)[i];
    const std::string text = entry.is_string() ? entry.get<std::string>() : "";
    const std::string name =
        with_extension(file.folder(), path_inside(file.folder(), text).value_or(""));
    if (!known.contains(name))
      file.fail(fmt::format(
          "entry {} of {}, '{}', is not the file_path of any frame; correct it or leave it out", i,
          key, text));
    names.insert(name);
  }
  return names;
}

/// Splits the images by nerfstudio's lists, if the file has any. Images in no list are dropped.
void split_by_lists(const TransformsFile& file, TransformsScene& scene) {
  Names known;
  for (const ColmapImage& image : scene.model.images) known.insert(image.name);
  const auto train = listed(file, "train_filenames", known);
  const auto test = listed(file, "test_filenames", known);
  const auto val = listed(file, "val_filenames", known);
  scene.has_split = train || test || val;
  if (!scene.has_split) return;

  const Names held_out = test && !test->empty() ? *test : val.value_or(Names());
  std::size_t in_both = 0;
  std::erase_if(scene.model.images, [&](const ColmapImage& image) {
    const bool is_listed = train && train->contains(image.name);
    if (held_out.contains(image.name)) {
      scene.test_names.push_back(image.name);
      in_both += is_listed;
      return false;
    }
    return train ? !is_listed : val && val->contains(image.name);
  });
  if (in_both)
    log_warning("{} listed both for training and for testing in {}: not used for training",
                counted(in_both, "photo", "is", "are"), file.path.string());
  if (scene.test_names.size() == scene.model.images.size())
    file.fail("train_filenames and test_filenames leave no frame to train on; correct the lists");
}

}  // namespace

bool has_transforms(const fs::path& folder) {
  return is_file(folder / kOneFile) || is_file(folder / kTrainFile);
}

bool is_blender_scene(const fs::path& folder) {
  return is_file(folder / kTrainFile) && !is_file(folder / kOneFile);
}

TransformsScene read_transforms(const fs::path& folder) {
  if (!has_transforms(folder))
    throw Error(fmt::format("{} holds neither {} nor {}; name a folder that does", folder.string(),
                            kOneFile, kTrainFile));
  TransformsScene scene;
  scene.model.folder = folder;
  FrameCollector collector(scene.model);
  const bool is_one_file = is_file(folder / kOneFile);
  const TransformsFile first = open_transforms_file(folder / (is_one_file ? kOneFile : kTrainFile));
  collector.add_frames(first);
  if (is_one_file) split_by_lists(first, scene);
  for (const char* name : {"transforms_test.json", "transforms_val.json"}) {
    if (is_one_file || scene.has_split || !is_file(folder / name)) continue;
    const std::size_t train_count = scene.model.images.size();
    collector.add_frames(open_transforms_file(folder / name));
    for (std::size_t i = train_count; i < scene.model.images.size(); ++i)
      scene.test_names.push_back(scene.model.images[i].name);
    scene.has_split = true;
  }
  scene.model.points = read_transforms_points(first);
  scene.time_count = collector.time_count();
  collector.normalize_times();
  return scene;
}

ColmapModel read_transforms_file(const fs::path& file) {
  ColmapModel model;
  model.folder = file.parent_path();
  FrameCollector collector(model);
  collector.add_frames(open_transforms_file(file));
  collector.normalize_times();
  return model;
}

}  // namespace gs
