// SPDX-License-Identifier: Apache-2.0
// Shared by the binary and the text reader of COLMAP models; used by colmap_*.cpp only.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_set>

#include "data_loaders/colmap/colmap_model.h"

namespace gs::colmap {

/// Throws Error: cannot read FILE in FOLDER: `what`; and the remedy.
[[noreturn]] void fail(const std::filesystem::path& file, const std::string& what);

/// The camera model of a name in cameras.txt.
std::optional<CameraModel> camera_model_of(std::string_view name);

/// The point id of a 2D point without a point.
inline constexpr std::uint64_t kNoPoint = ~std::uint64_t(0);

/// The number of a camera among the kinds of sensor.
inline constexpr std::int32_t kCameraSensor = 0;

/// Collects the records of a model. Each function adds one record and returns its fault, "" if
/// there is none; the reader then adds the place in the file to the message.
class ModelBuilder {
 public:
  ModelBuilder(ColmapModel& model, Tracks tracks) : model_(model), tracks_(tracks) {}

  bool wants_observations() const { return tracks_ == Tracks::read; }

  std::string add_camera(ColmapCamera camera, std::uint64_t width, std::uint64_t height);
  std::string add_image(ColmapImage image);  // after the cameras
  /// Adds them to the image that was added last.
  void add_observations(std::vector<ColmapObservation> observations) {
    model_.images.back().observations = std::move(observations);
  }
  void add_point(const ColmapPoint& point) { model_.points.push_back(point); }
  std::string add_rig(ColmapRig rig);
  std::string add_frame(ColmapFrame frame);

 private:
  ColmapModel& model_;
  Tracks tracks_;
  std::unordered_set<std::uint64_t> image_ids_, rig_ids_, frame_ids_, framed_image_ids_;
  std::unordered_set<std::string> image_names_;
};

/// The number of images in one file. Throw Error.
std::uint64_t count_binary_images(const std::filesystem::path& file);
std::uint64_t count_text_images(const std::filesystem::path& file);

/// Read one file of a model. Throw Error.
void read_binary_cameras(const std::filesystem::path& file, ModelBuilder& model);
void read_binary_images(const std::filesystem::path& file, ModelBuilder& model);
void read_binary_points(const std::filesystem::path& file, ModelBuilder& model);
void read_binary_rigs(const std::filesystem::path& file, ModelBuilder& model);
void read_binary_frames(const std::filesystem::path& file, ModelBuilder& model);
void read_text_cameras(const std::filesystem::path& file, ModelBuilder& model);
void read_text_images(const std::filesystem::path& file, ModelBuilder& model);
void read_text_points(const std::filesystem::path& file, ModelBuilder& model);
void read_text_rigs(const std::filesystem::path& file, ModelBuilder& model);
void read_text_frames(const std::filesystem::path& file, ModelBuilder& model);

}  // namespace gs::colmap
