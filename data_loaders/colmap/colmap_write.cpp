// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/colmap/colmap_write.h"

#include <unordered_map>

#include "data_loaders/colmap/colmap_files.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/files/atomic_file.h"

namespace gs {
namespace {

/// Values one behind another, as COLMAP's binary files have them.
class Bytes {
 public:
  template <class T>
  void add(T value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  void add(const Vec3d& v) { add(v.x), add(v.y), add(v.z); }
  void add(const Quat<double>& q) { add(q.w), add(q.x), add(q.y), add(q.z); }
  void add(const std::string& text) { bytes_.append(text.c_str(), text.size() + 1); }
  void append(const Bytes& other) { bytes_ += other.bytes_; }

  void write(const std::filesystem::path& path) const {
    AtomicFile file(path);
    file.write(bytes_);
    file.commit();
  }

 private:
  std::string bytes_;
};

Bytes cameras_of(const ColmapModel& model) {
  Bytes out;
  out.add(std::uint64_t(model.cameras.size()));
  for (const auto& [id, camera] : model.cameras) {
    out.add(id);
    out.add(std::int32_t(camera.model));
    out.add(std::uint64_t(camera.width));
    out.add(std::uint64_t(camera.height));
    for (const double param : camera.params) out.add(param);
  }
  return out;
}

Bytes images_of(const ColmapModel& model) {
  Bytes out;
  out.add(std::uint64_t(model.images.size()));
  for (const ColmapImage& image : model.images) {
    out.add(image.id);
    out.add(image.cam_from_world_rotation);
    out.add(image.cam_from_world_translation);
    out.add(image.camera_id);
    out.add(image.name);
    out.add(std::uint64_t(image.observations.size()));
    for (const ColmapObservation& seen : image.observations) {
      out.add(seen.x);
      out.add(seen.y);
      out.add(seen.point_id);
    }
  }
  return out;
}

Bytes points_of(const ColmapModel& model) {
  struct Element {
    std::uint32_t image_id, observation;
  };
  std::unordered_map<std::uint64_t, std::vector<Element>> tracks;
  for (const ColmapImage& image : model.images)
    for (std::size_t k = 0; k < image.observations.size(); ++k)
      tracks[image.observations[k].point_id].push_back({image.id, std::uint32_t(k)});
  Bytes out;
  out.add(std::uint64_t(model.points.size()));
  for (const ColmapPoint& point : model.points) {
    out.add(point.id);
    out.add(point.position);
    for (const std::uint8_t channel : point.color) out.add(channel);
    out.add(point.error);
    const std::vector<Element>& track = tracks[point.id];
    out.add(std::uint64_t(track.size()));
    for (const Element& element : track) {
      out.add(element.image_id);
      out.add(element.observation);
    }
  }
  return out;
}

Bytes rigs_of(const ColmapModel& model) {
  Bytes out;
  out.add(std::uint64_t(model.rigs.size()));
  for (const ColmapRig& rig : model.rigs) {
    out.add(rig.id);
    out.add(std::uint32_t(rig.cameras.size()));
    for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
      const ColmapRigCamera& camera = rig.cameras[k];
      out.add(colmap::kCameraSensor);
      out.add(camera.camera_id);
      if (k == 0) continue;  // the origin of the rig
      out.add(std::uint8_t(camera.has_pose));
      if (!camera.has_pose) continue;
      out.add(camera.cam_from_rig_rotation);
      out.add(camera.cam_from_rig_translation);
    }
  }
  return out;
}

/// Where a rig's camera sits on it: the identity for the first camera and for unknown ones.
ColmapRigCamera place_on_rig(const ColmapModel& model, std::uint32_t rig_id, std::uint32_t camera) {
  for (const ColmapRig& rig : model.rigs)
    if (rig.id == rig_id)
      for (const ColmapRigCamera& place : rig.cameras)
        if (place.camera_id == camera) return place;
  return {};
}

/// rig_from_world of the moment of an image: cam_from_rig^-1 cam_from_world.
void add_rig_pose(Bytes& out, const ColmapImage& image, const ColmapRigCamera& place) {
  const Mat3<double> cam_from_rig = rotation_matrix(place.cam_from_rig_rotation);
  const Mat3<double> cam_from_world = rotation_matrix(image.cam_from_world_rotation);
  const auto column = [&](double x, double y, double z) {
    return multiply_transposed(cam_from_rig, Vec3d(x, y, z));
  };
  const Mat3<double>& C = cam_from_world;
  const Vec3d a = column(C.row0.x, C.row1.x, C.row2.x), b = column(C.row0.y, C.row1.y, C.row2.y),
              c = column(C.row0.z, C.row1.z, C.row2.z);
  out.add(quaternion_of(Mat3<double>{{a.x, b.x, c.x}, {a.y, b.y, c.y}, {a.z, b.z, c.z}}));
  out.add(multiply_transposed(cam_from_rig,
                              image.cam_from_world_translation - place.cam_from_rig_translation));
}

Bytes frames_of(const ColmapModel& model) {
  std::unordered_map<std::uint64_t, const ColmapImage*> image_of;
  for (const ColmapImage& image : model.images) image_of[image.id] = &image;
  Bytes out;
  std::uint64_t count = 0;
  for (const ColmapFrame& frame : model.frames) {
    std::vector<const ColmapImage*> images;  // those of the model
    for (const std::uint64_t id : frame.image_ids)
      if (const auto found = image_of.find(id); found != image_of.end())
        images.push_back(found->second);
    if (images.empty()) continue;
    ++count;
    out.add(frame.id);
    out.add(frame.rig_id);
    add_rig_pose(out, *images[0], place_on_rig(model, frame.rig_id, images[0]->camera_id));
    out.add(std::uint32_t(images.size()));
    for (const ColmapImage* image : images) {
      out.add(colmap::kCameraSensor);
      out.add(image->camera_id);
      out.add(std::uint64_t(image->id));
    }
  }
  Bytes file;
  file.add(count);
  file.append(out);
  return file;
}

}  // namespace

void write_colmap_model(const std::filesystem::path& folder, const ColmapModel& model) {
  images_of(model).write(folder / "images.bin");
  points_of(model).write(folder / "points3D.bin");
  if (!model.rigs.empty()) rigs_of(model).write(folder / "rigs.bin");
  if (!model.frames.empty()) frames_of(model).write(folder / "frames.bin");
  cameras_of(model).write(folder / "cameras.bin");
}

}  // namespace gs
