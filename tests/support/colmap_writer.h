// SPDX-License-Identifier: Apache-2.0
// Writes small COLMAP models in both encodings, and the photos that belong to them.
#pragma once

#include <cstring>
#include <filesystem>
#include <sstream>
#include <string>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "tests/support/temp_folder.h"

namespace gs {

/// Appends plain values to one another, as COLMAP's binary files have them.
class Bytes {
 public:
  template <class T>
  Bytes& add(T value) {
    const auto* begin = reinterpret_cast<const char*>(&value);
    bytes_.append(begin, sizeof(T));
    return *this;
  }
  Bytes& add_text(const std::string& text) {
    bytes_ += text;
    return *this;
  }
  const std::string& str() const { return bytes_; }

 private:
  std::string bytes_;
};

inline std::string binary_cameras(const ColmapModel& model) {
  Bytes out;
  out.add<std::uint64_t>(model.cameras.size());
  for (const auto& [id, camera] : model.cameras) {
    out.add<std::uint32_t>(id).add<std::int32_t>(int(camera.model));
    out.add<std::uint64_t>(camera.width).add<std::uint64_t>(camera.height);
    for (double param : camera.params) out.add(param);
  }
  return out.str();
}

/// Image i has i 2D points that belong to no 3D point, and after them its observations.
inline std::string binary_images(const ColmapModel& model) {
  Bytes out;
  out.add<std::uint64_t>(model.images.size());
  std::uint64_t point_count = 0;
  for (const ColmapImage& image : model.images) {
    const Quat<double>& q = image.cam_from_world_rotation;
    const Vec3d& t = image.cam_from_world_translation;
    out.add<std::uint32_t>(image.id).add(q.w).add(q.x).add(q.y).add(q.z).add(t.x).add(t.y).add(t.z);
    out.add<std::uint32_t>(image.camera_id).add_text(image.name).add('\0');
    out.add<std::uint64_t>(point_count + image.observations.size());
    for (std::uint64_t k = 0; k < point_count; ++k) out.add(1.5).add(2.5).add(~std::uint64_t(0));
    for (const ColmapObservation& seen : image.observations)
      out.add(seen.x).add(seen.y).add(seen.point_id);
    ++point_count;
  }
  return out.str();
}

/// Point i has a track of i elements.
inline std::string binary_points(const ColmapModel& model) {
  Bytes out;
  out.add<std::uint64_t>(model.points.size());
  std::uint64_t track_length = 0;
  for (const ColmapPoint& point : model.points) {
    out.add(point.id).add(point.position.x).add(point.position.y).add(point.position.z);
    for (std::uint8_t channel : point.color) out.add(channel);
    out.add(0.5).add(track_length);
    for (std::uint64_t k = 0; k < track_length; ++k)
      out.add<std::uint32_t>(1).add<std::uint32_t>(7);
    ++track_length;
  }
  return out.str();
}

inline std::string binary_rigs(const ColmapModel& model) {
  Bytes out;
  out.add<std::uint64_t>(model.rigs.size());
  for (const ColmapRig& rig : model.rigs) {
    out.add<std::uint32_t>(rig.id).add<std::uint32_t>(rig.cameras.size());
    for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
      const ColmapRigCamera& camera = rig.cameras[k];
      out.add<std::int32_t>(0).add<std::uint32_t>(camera.camera_id);
      if (k > 0) out.add<std::uint8_t>(camera.has_pose);
      if (k == 0 || !camera.has_pose) continue;
      const Quat<double>& q = camera.cam_from_rig_rotation;
      const Vec3d& t = camera.cam_from_rig_translation;
      out.add(q.w).add(q.x).add(q.y).add(q.z).add(t.x).add(t.y).add(t.z);
    }
  }
  return out.str();
}

/// Every frame also has data of a sensor that is not a camera, with an id that no image has.
inline std::string binary_frames(const ColmapModel& model) {
  Bytes out;
  out.add<std::uint64_t>(model.frames.size());
  for (const ColmapFrame& frame : model.frames) {
    out.add<std::uint32_t>(frame.id).add<std::uint32_t>(frame.rig_id);
    for (double value : {1, 0, 0, 0, 0, 0, 0}) out.add(value);
    out.add<std::uint32_t>(frame.image_ids.size() + 1);
    for (std::uint64_t id : frame.image_ids)
      out.add<std::int32_t>(0).add<std::uint32_t>(7).add<std::uint64_t>(id);
    out.add<std::int32_t>(1).add<std::uint32_t>(1).add<std::uint64_t>(77);
  }
  return out.str();
}

/// rigs and frames are written if the model has any.
inline void write_binary_model(const std::filesystem::path& folder, const ColmapModel& model) {
  write_bytes(folder / "cameras.bin", binary_cameras(model));
  write_bytes(folder / "images.bin", binary_images(model));
  write_bytes(folder / "points3D.bin", binary_points(model));
  if (!model.rigs.empty()) write_bytes(folder / "rigs.bin", binary_rigs(model));
  if (!model.frames.empty()) write_bytes(folder / "frames.bin", binary_frames(model));
}

inline std::string text_rigs(const ColmapModel& model) {
  std::ostringstream out;
  out.precision(17);
  out << "# Rig calib list with one line of data per calib:\n";
  for (const ColmapRig& rig : model.rigs) {
    out << rig.id << " " << rig.cameras.size();
    for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
      const ColmapRigCamera& camera = rig.cameras[k];
      out << " CAMERA " << camera.camera_id;
      if (k > 0) out << " " << camera.has_pose;
      if (k == 0 || !camera.has_pose) continue;
      const Quat<double>& q = camera.cam_from_rig_rotation;
      const Vec3d& t = camera.cam_from_rig_translation;
      out << " " << q.w << " " << q.x << " " << q.y << " " << q.z << " " << t.x << " " << t.y << " "
          << t.z;
    }
    out << "\n";
  }
  return out.str();
}

/// Like binary_frames().
inline std::string text_frames(const ColmapModel& model) {
  std::ostringstream out;
  out << "# Frame list with one line of data per frame:\n";
  for (const ColmapFrame& frame : model.frames) {
    out << frame.id << " " << frame.rig_id << " 1 0 0 0 0 0 0 " << frame.image_ids.size() + 1;
    for (std::uint64_t id : frame.image_ids) out << " CAMERA 7 " << id;
    out << " IMU 1 77\n";
  }
  return out.str();
}

inline void write_text_model(const std::filesystem::path& folder, const ColmapModel& model) {
  std::ostringstream cameras, images, points;
  for (std::ostringstream* out : {&cameras, &images, &points}) {
    out->precision(17);
    *out << "# a comment\n";
  }
  for (const auto& [id, camera] : model.cameras) {
    cameras << id << " " << camera_model_info(camera.model).name << " " << camera.width << " "
            << camera.height;
    for (double param : camera.params) cameras << " " << param;
    cameras << "\n";
  }
  std::uint64_t point_count = 0;
  for (const ColmapImage& image : model.images) {
    const Quat<double>& q = image.cam_from_world_rotation;
    const Vec3d& t = image.cam_from_world_translation;
    images << image.id << " " << q.w << " " << q.x << " " << q.y << " " << q.z << " " << t.x << " "
           << t.y << " " << t.z << " " << image.camera_id << " " << image.name << "\n";
    for (std::uint64_t k = 0; k < point_count; ++k) images << (k ? " " : "") << "1.5 2.5 -1";
    for (const ColmapObservation& seen : image.observations)
      images << " " << seen.x << " " << seen.y << " " << seen.point_id;
    images << "\n";
    ++point_count;
  }
  for (const ColmapPoint& point : model.points) {
    points << point.id << " " << point.position.x << " " << point.position.y << " "
           << point.position.z;
    for (std::uint8_t channel : point.color) points << " " << int(channel);
    points << " 0.5 1 7\n";
  }
  write_bytes(folder / "cameras.txt", cameras.str());
  write_bytes(folder / "images.txt", images.str());
  write_bytes(folder / "points3D.txt", points.str());
  if (!model.rigs.empty()) write_bytes(folder / "rigs.txt", text_rigs(model));
  if (!model.frames.empty()) write_bytes(folder / "frames.txt", text_frames(model));
}

/// A photo of one color.
inline Image8 plain_photo(int width, int height, std::uint8_t value) {
  return Image8(width, height, 3, value);
}

/// A model with one PINHOLE camera of 12 x 8 pixels and `count` images named a.png, b.png, ...,
/// which look along z from (i, 0, 0), and two points.
inline ColmapModel small_model(int count) {
  ColmapModel model;
  model.cameras[7] = {7, CameraModel::pinhole, 12, 8, {10, 11, 6.5, 3.5}};
  for (int i = 0; i < count; ++i) {
    const std::string name = std::string(1, char('a' + i)) + ".png";
    model.images.push_back({std::uint32_t(i + 1), name, 7, {1, 0, 0, 0}, {-double(i), 0.0, 0.0}});
  }
  model.points.push_back({5, {1.0, 2.0, 3.0}, {10, 20, 30}});
  model.points.push_back({900000000000, {-1.0, 0.5, 4.0}, {255, 0, 1}});
  return model;
}

/// Writes the model to sparse/0 and a photo for every image to images/; photo i has the value 10 *
/// i.
inline void write_scene(const std::filesystem::path& folder, const ColmapModel& model) {
  write_binary_model(folder / "sparse" / "0", model);
  int value = 0;
  for (const ColmapImage& image : model.images) {
    const ColmapCamera& camera = model.cameras.at(image.camera_id);
    write_png(folder / "images" / image.name,
              plain_photo(camera.width, camera.height, std::uint8_t(value)));
    value += 10;
  }
}

}  // namespace gs
