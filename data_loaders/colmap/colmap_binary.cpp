// SPDX-License-Identifier: Apache-2.0
// cameras.bin, images.bin, points3D.bin, rigs.bin and frames.bin: little-endian records behind a
// count (COLMAP, doc/format.rst; the last two as its reconstruction_io_binary.cc writes them).
//
//   cameras.bin   u64 n;  n x { u32 id, i32 model, u64 width, u64 height, f64 params[] }
//   images.bin    u64 n;  n x { u32 id, f64 qw qx qy qz, f64 tx ty tz, u32 camera, name NUL,
//                               u64 m, m x { f64 x, f64 y, u64 point } }
//   points3D.bin  u64 n;  n x { u64 id, f64 x y z, u8 r g b, f64 error,
//                               u64 m, m x { u32 image, u32 index } }
//   rigs.bin      u64 n;  n x { u32 id, u32 m, m x { i32 kind, u32 sensor,
//                               u8 has_pose, [f64 qw qx qy qz, f64 tx ty tz] } }
//                               (the first of the m, the reference, ends with its sensor)
//   frames.bin    u64 n;  n x { u32 id, u32 rig, f64 qw qx qy qz, f64 tx ty tz,
//                               u32 m, m x { i32 kind, u32 sensor, u64 data } }
//                               (data of a camera is an image id)
#include <spdlog/fmt/fmt.h>

#include <bit>
#include <cmath>
#include <cstring>

#include "data_loaders/colmap/colmap_files.h"
#include "gs_core/system/byte_reader.h"

namespace gs::colmap {
namespace {

namespace fs = std::filesystem;
static_assert(std::endian::native == std::endian::little);

// The least that one record takes, in bytes.
constexpr std::uint64_t kCameraBytes = 4 + 4 + 8 + 8 + 2 * 8;
constexpr std::uint64_t kImageBytes = 4 + 7 * 8 + 4 + 1 + 8;
constexpr std::uint64_t kPoint2dBytes = 8 + 8 + 8;
constexpr std::uint64_t kPointBytes = 8 + 3 * 8 + 3 + 8 + 8;
constexpr std::uint64_t kTrackBytes = 4 + 4;
constexpr std::uint64_t kPoseBytes = 7 * 8;
constexpr std::uint64_t kRigBytes = 4 + 4;
constexpr std::uint64_t kSensorBytes = 4 + 4;
constexpr std::uint64_t kFrameBytes = 4 + 4 + kPoseBytes + 4;
constexpr std::uint64_t kDataBytes = 4 + 4 + 8;
constexpr std::size_t kLongestName = 4096;  // bytes; PATH_MAX of Linux

/// One file of a model: plain values, counts that are checked against what is left, and complaints
/// that name the byte.
class BinaryFile {
 public:
  explicit BinaryFile(const fs::path& path) : bytes_(path) {}

  template <class T>
  T take() {
    require(sizeof(T));
    T value;
    std::memcpy(&value, bytes_.take(sizeof(T)), sizeof(T));
    return value;
  }

  /// The number of records that follow, each of at least `record_bytes`.
  template <class Count = std::uint64_t>
  std::uint64_t take_count(const char* records, std::uint64_t record_bytes) {
    const std::uint64_t count = take<Count>();
    if (count > bytes_.left() / record_bytes)
      fail(fmt::format("it promises {} {} of at least {} bytes each and has {} bytes left", count,
                       records, record_bytes, bytes_.left()));
    return count;
  }

  std::string take_name() {
    std::string name;
    for (char c = take<char>(); c != '\0'; c = take<char>()) {
      if (name.size() == kLongestName)
        fail(fmt::format("an image name is longer than {} bytes", kLongestName));
      name += c;
    }
    return name;
  }

  void skip(std::uint64_t bytes) {
    require(bytes);
    bytes_.skip(bytes);
  }

  /// Checks that nothing follows the last record.
  void expect_end() const {
    if (bytes_.left()) fail(fmt::format("{} bytes follow its last record", bytes_.left()));
  }
  void expect_good(const std::string& fault) const {
    if (!fault.empty()) fail(fault);
  }
  [[noreturn]] void fail(const std::string& what) const {
    colmap::fail(bytes_.path(), fmt::format("{} at byte {}", what, bytes_.position()));
  }

 private:
  void require(std::uint64_t bytes) const {
    if (bytes > bytes_.left()) fail(fmt::format("{} bytes short", bytes - bytes_.left()));
  }

  ByteReader bytes_;
};

Quat<double> take_quaternion(BinaryFile& file) {
  Quat<double> q;
  for (double* part : {&q.w, &q.x, &q.y, &q.z}) *part = file.take<double>();
  return q;
}

Vec3d take_vector(BinaryFile& file) {
  Vec3d v;
  v.x = file.take<double>();
  v.y = file.take<double>();
  v.z = file.take<double>();
  return v;
}

std::vector<ColmapObservation> take_observations(BinaryFile& file, std::uint64_t count) {
  std::vector<ColmapObservation> observations;
  for (std::uint64_t i = 0; i < count; ++i) {
    ColmapObservation at;
    at.x = file.take<double>();
    at.y = file.take<double>();
    at.point_id = file.take<std::uint64_t>();
    if (at.point_id != kNoPoint && std::isfinite(at.x) && std::isfinite(at.y))
      observations.push_back(at);
  }
  observations.shrink_to_fit();
  return observations;
}

/// Calls read(file) for each record of a file: as many as the count at its start says.
template <class Read>
void for_each_record(const fs::path& path, const char* records, std::uint64_t record_bytes,
                     Read&& read) {
  BinaryFile file(path);
  const std::uint64_t count = file.take_count(records, record_bytes);
  for (std::uint64_t i = 0; i < count; ++i) read(file);
  file.expect_end();
}

void read_camera(BinaryFile& file, ModelBuilder& model) {
  ColmapCamera camera;
  camera.id = file.take<std::uint32_t>();
  const auto model_id = file.take<std::int32_t>();
  if (model_id < 0 || model_id >= kCameraModelCount)
    file.fail(fmt::format("camera {} has the unknown camera model {} (known: 0 to {})", camera.id,
                          model_id, kCameraModelCount - 1));
  camera.model = CameraModel(model_id);
  const auto width = file.take<std::uint64_t>(), height = file.take<std::uint64_t>();
  for (int k = 0; k < camera_model_info(camera.model).param_count; ++k)
    camera.params.push_back(file.take<double>());
  file.expect_good(model.add_camera(std::move(camera), width, height));
}

void read_image(BinaryFile& file, ModelBuilder& model) {
  ColmapImage image;
  image.id = file.take<std::uint32_t>();
  image.cam_from_world_rotation = take_quaternion(file);
  image.cam_from_world_translation = take_vector(file);
  image.camera_id = file.take<std::uint32_t>();
  image.name = file.take_name();
  file.expect_good(model.add_image(std::move(image)));
  const std::uint64_t points = file.take_count("2D points", kPoint2dBytes);
  if (model.wants_observations())
    model.add_observations(take_observations(file, points));
  else
    file.skip(points * kPoint2dBytes);
}

void read_point(BinaryFile& file, ModelBuilder& model) {
  ColmapPoint point;
  point.id = file.take<std::uint64_t>();
  point.position = take_vector(file);
  for (std::uint8_t& channel : point.color) channel = file.take<std::uint8_t>();
  point.error = file.take<double>();
  point.observations = file.take_count("track elements", kTrackBytes);
  file.skip(point.observations * kTrackBytes);
  model.add_point(point);
}

/// The camera of one sensor. The first sensor of a rig is its reference and has no pose.
ColmapRigCamera take_rig_camera(BinaryFile& file, bool is_reference) {
  ColmapRigCamera camera;
  camera.camera_id = file.take<std::uint32_t>();
  camera.has_pose = is_reference || file.take<std::uint8_t>() != 0;
  if (camera.has_pose && !is_reference) {
    camera.cam_from_rig_rotation = take_quaternion(file);
    camera.cam_from_rig_translation = take_vector(file);
  }
  return camera;
}

void read_rig(BinaryFile& file, ModelBuilder& model) {
  ColmapRig rig;
  rig.id = file.take<std::uint32_t>();
  const std::uint64_t sensors = file.take_count<std::uint32_t>("sensors", kSensorBytes);
  for (std::uint64_t k = 0; k < sensors; ++k) {
    const auto kind = file.take<std::int32_t>();
    const ColmapRigCamera camera = take_rig_camera(file, k == 0);
    if (kind == kCameraSensor) rig.cameras.push_back(camera);
  }
  file.expect_good(model.add_rig(std::move(rig)));
}

void read_frame(BinaryFile& file, ModelBuilder& model) {
  ColmapFrame frame;
  frame.id = file.take<std::uint32_t>();
  frame.rig_id = file.take<std::uint32_t>();
  file.skip(kPoseBytes);  // every image has its own pose
  const std::uint64_t data = file.take_count<std::uint32_t>("data ids", kDataBytes);
  for (std::uint64_t k = 0; k < data; ++k) {
    const auto kind = file.take<std::int32_t>();
    file.skip(sizeof(std::uint32_t));  // the sensor
    const auto id = file.take<std::uint64_t>();
    if (kind == kCameraSensor) frame.image_ids.push_back(id);
  }
  file.expect_good(model.add_frame(std::move(frame)));
}

}  // namespace

std::uint64_t count_binary_images(const fs::path& path) {
  return BinaryFile(path).take_count("images", kImageBytes);
}

void read_binary_cameras(const fs::path& path, ModelBuilder& model) {
  for_each_record(path, "cameras", kCameraBytes, [&](auto& file) { read_camera(file, model); });
}

void read_binary_images(const fs::path& path, ModelBuilder& model) {
  for_each_record(path, "images", kImageBytes, [&](auto& file) { read_image(file, model); });
}

void read_binary_points(const fs::path& path, ModelBuilder& model) {
  for_each_record(path, "points", kPointBytes, [&](auto& file) { read_point(file, model); });
}

void read_binary_rigs(const fs::path& path, ModelBuilder& model) {
  for_each_record(path, "rigs", kRigBytes, [&](auto& file) { read_rig(file, model); });
}

void read_binary_frames(const fs::path& path, ModelBuilder& model) {
  for_each_record(path, "frames", kFrameBytes, [&](auto& file) { read_frame(file, model); });
}

}  // namespace gs::colmap
