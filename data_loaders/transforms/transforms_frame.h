// SPDX-License-Identifier: Apache-2.0
// One frame of a transforms.json: the name, mask, depth map, camera, pose and time of a photo; used
// by transforms_json.cpp only. The table of keys stands in transforms_json.h.
#pragma once

#include <initializer_list>
#include <optional>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/transforms/transforms_file.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// Where a camera was.
struct FramePose {
  Quat<double> cam_from_world_rotation;  // unit length
  Vec3d center;                          // world units
};

/// Reads the entries of one frame. Each error names the file, the frame and the key. The file
/// outlives the reader.
class TransformsFrame {
 public:
  TransformsFrame(const TransformsFile& file, std::size_t index);

  /// The name of the photo, relative to the file's folder.
  std::string name() const;
  /// The file of the photo's mask; empty if the frame names none.
  std::filesystem::path mask() const;
  /// The file of the photo's depth map; empty if the frame names none that is there.
  std::filesystem::path depth() const;
  /// The camera, without an id. `name` is that of the photo.
  ColmapCamera camera(const std::string& name) const;
  /// Sets rotation and translation, and the motion of a rolling shutter.
  void read_pose(ColmapImage& image) const;
  /// When the photo was taken; nothing if the frame does not say. Scenes that move have it.
  std::optional<double> time() const;

 private:
  [[noreturn]] void fail(const std::string& what,
                         const char* remedy = "; correct the entry or write the file again") const;
  [[noreturn]] void fail_matrix(const char* key) const;
  const SortedJson* find(const char* key) const;
  const std::string& text(const SortedJson& value, const char* key) const;
  double number(const SortedJson& value, const char* key) const;
  double number_or(const char* key, double otherwise) const;
  Vec4<double> row(const SortedJson& value, const char* key) const;
  FramePose pose(const char* key) const;
  void check_rolling_shutter() const;

  std::string model_name() const;
  int side(double pixels, const char* key) const;
  PhotoSize picture_size(const std::string& name) const;
  double positive(const SortedJson& value, const char* key, double below) const;
  std::optional<double> focal_length(const char* key, const char* angle_key, int side) const;
  void add_lens(const std::string& model, ColmapCamera& camera) const;
  void expect_zero(const std::string& model, std::initializer_list<const char*> keys) const;

  const TransformsFile& file_;
  const SortedJson& frame_;
  std::string place_;  // for error messages
};

}  // namespace gs
