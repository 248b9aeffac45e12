// SPDX-License-Identifier: Apache-2.0
// cameras.bin, images.bin and points3D.bin: little-endian records behind a count (COLMAP,
// doc/format.rst).
//
//   cameras.bin   u64 n;  n x { u32 id, i32 model, u64 width, u64 height, f64 params[] }
//   images.bin    u64 n;  n x { u32 id, f64 qw qx qy qz, f64 tx ty tz, u32 camera, name NUL,
//                               u64 m, m x { f64 x, f64 y, u64 point } }
//   points3D.bin  u64 n;  n x { u64 id, f64 x y z, u8 r g b, f64 error,
//                               u64 m, m x { u32 image, u32 index } }
#include <spdlog/fmt/fmt.h>

#include <bit>
#include <cstring>

#include "data_loaders/byte_reader.h"
#include "data_loaders/colmap_files.h"

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
  std::uint64_t take_count(const char* records, std::uint64_t record_bytes) {
    const std::uint64_t count = take<std::uint64_t>();
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

  /// After the last record: nothing may follow.
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

Vec3d take_vector(BinaryFile& file) {
  Vec3d v;
  v.x = file.take<double>();
  v.y = file.take<double>();
  v.z = file.take<double>();
  return v;
}

}  // namespace

void read_binary_cameras(const fs::path& path, ColmapModel& model) {
  BinaryFile file(path);
  const std::uint64_t count = file.take_count("cameras", kCameraBytes);
  for (std::uint64_t i = 0; i < count; ++i) {
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
    file.expect_good(add_camera(model, std::move(camera), width, height));
  }
  file.expect_end();
}

void read_binary_images(const fs::path& path, ColmapModel& model) {
  BinaryFile file(path);
  const std::uint64_t count = file.take_count("images", kImageBytes);
  model.images.reserve(count);
  for (std::uint64_t i = 0; i < count; ++i) {
    ColmapImage image;
    image.id = file.take<std::uint32_t>();
    Quat<double>& q = image.cam_from_world_rotation;
    for (double* part : {&q.w, &q.x, &q.y, &q.z}) *part = file.take<double>();
    image.cam_from_world_translation = take_vector(file);
    image.camera_id = file.take<std::uint32_t>();
    image.name = file.take_name();
    file.expect_good(add_image(model, std::move(image)));
    file.skip(file.take_count("2D points", kPoint2dBytes) * kPoint2dBytes);
  }
  file.expect_end();
}

void read_binary_points(const fs::path& path, ColmapModel& model) {
  BinaryFile file(path);
  const std::uint64_t count = file.take_count("points", kPointBytes);
  model.points.reserve(count);
  for (std::uint64_t i = 0; i < count; ++i) {
    ColmapPoint point;
    point.id = file.take<std::uint64_t>();
    point.position = take_vector(file);
    for (std::uint8_t& channel : point.color) channel = file.take<std::uint8_t>();
    file.skip(sizeof(double));  // reprojection error
    file.expect_good(add_point(model, point));
    file.skip(file.take_count("track elements", kTrackBytes) * kTrackBytes);
  }
  file.expect_end();
}

}  // namespace gs::colmap
