// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/cameras/camera_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/lens/lens_projection.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

// Keys in our order, and float as the number type: written with the digits that a float needs.

constexpr int kLargestSide = 1 << 20;        // pixels; more is a mistake
constexpr float kRotationTolerance = 0.01f;  // files with three digits pass, scaled matrices do not

// --- Writing

FloatJson to_json(const Vec3f& v) { return FloatJson::array({v.x, v.y, v.z}); }

struct LensWord {
  Lens lens;
  const char* word;
};
constexpr LensWord kLensWords[] = {
    {Lens::none, "pinhole"},    {Lens::radial_tangential, "radial_tangential"},
    {Lens::fisheye, "fisheye"}, {Lens::fisheye_rad_tan, "fisheye_rad_tan"},
    {Lens::fov, "fov"},         {Lens::division, "division"},
    {Lens::unified, "unified"}, {Lens::orthographic, "orthographic"}};

/// Calls f(key, numbers, count) for the numbers of a lens. An angle chart has no range of u.
template <class CameraLens, class F>
void for_each_lens_key(CameraLens& lens, F&& f) {
  f("k", lens.k, 6), f("d", lens.d, 3), f("p", lens.p, 2), f("s", lens.s, 4);
  f("radius", &lens.radius, 1);
  if (has_perspective_chart(lens.lens)) f("low", &lens.low.x, 2), f("high", &lens.high.x, 2);
  f("turn", &lens.motion.turn.x, 3), f("shift", &lens.motion.shift.x, 3);
  f("rows", &lens.rows.x, 2);
}

FloatJson to_json(const CameraLens<float>& lens) {
  FloatJson json;
  json["kind"] = word_of(lens.lens);
  for_each_lens_key(lens, [&](const char* key, const float* numbers, int count) {
    const auto has_value = [](float x) { return x != 0 && std::isfinite(x); };
    if (std::any_of(numbers, numbers + count, has_value))
      json[key] = std::vector<float>(numbers, numbers + count);
  });
  return json;
}

std::string camera_line(const std::string& name, const Camera& camera, std::size_t id) {
  const Mat3<float>& R = camera.cam_from_world_rotation;
  const Mat3<double> R_double{Vec3d(R.row0), Vec3d(R.row1), Vec3d(R.row2)};
  const Vec3d position =  // the difference avoids -0
      Vec3d(0.0) - multiply_transposed(R_double, Vec3d(camera.cam_from_world_translation));
  FloatJson json;
  json["id"] = id;
  json["img_name"] = name;
  json["width"] = camera.width;
  json["height"] = camera.height;
  json["position"] = to_json(Vec3f(position));
  json["rotation"] = FloatJson::array({to_json({R.row0.x, R.row1.x, R.row2.x}),
                                       to_json({R.row0.y, R.row1.y, R.row2.y}),
                                       to_json({R.row0.z, R.row1.z, R.row2.z})});
  json["fy"] = camera.fy;
  json["fx"] = camera.fx;
  json["cx"] = camera.cx;
  json["cy"] = camera.cy;
  if (camera.time != 0) json["time"] = camera.time;
  if (camera.has_lens()) json["lens"] = to_json(camera.lens);
  return json.dump(-1, ' ', false, FloatJson::error_handler_t::replace);
}

// --- Reading

/// One entry of the list; knows where it stands for error messages.
class CameraReader {
 public:
  CameraReader(const SortedJson& json, std::size_t index, const std::filesystem::path& path)
      : json_(json), index_(index), path_(path) {
    if (!json.is_object()) fail("is not an object");
  }

  /// The camera, but for its translation, and where it stands.
  std::pair<NamedCamera, Vec3d> read() const {
    NamedCamera result;
    const SortedJson& name = at("img_name");
    if (!name.is_string()) fail("has no text as img_name");
    result.name = name.get<std::string>();
    Camera& camera = result.camera;
    camera.width = side("width");
    camera.height = side("height");
    camera.fx = positive("fx");
    camera.fy = positive("fy");
    camera.cx = json_.contains("cx") ? number(at("cx"), "cx") : 0.5f * float(camera.width);
    camera.cy = json_.contains("cy") ? number(at("cy"), "cy") : 0.5f * float(camera.height);
    camera.time = json_.contains("time") ? number(at("time"), "time") : 0.0f;
    camera.cam_from_world_rotation = rotation();
    if (json_.contains("lens")) camera.lens = lens(at("lens"));
    return {std::move(result), position()};
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    cannot_read(path_,
                fmt::format("camera {} of the list {}; correct the entry or write the file again",
                            index_, what));
  }
  const SortedJson& at(const char* key) const {
    const auto found = json_.find(key);
    if (found == json_.end()) fail(fmt::format("lacks {}", key));
    return *found;
  }
  double precise(const SortedJson& value, const char* key) const {
    const double result = value.is_number() ? value.get<double>() : NAN;
    if (!std::isfinite(float(result))) fail(fmt::format("has no number as {}", key));
    return result;
  }
  float number(const SortedJson& value, const char* key) const {
    return float(precise(value, key));
  }
  float positive(const char* key) const {
    const float result = number(at(key), key);
    if (result <= 0) fail(fmt::format("has {} as {}, which must be above 0", result, key));
    return result;
  }
  int side(const char* key) const {
    const float pixels = positive(key);
    if (pixels > kLargestSide || pixels != std::floor(pixels)) {
      fail(fmt::format("has {} as {}, which must be a number of pixels", pixels, key));
    }
    return int(pixels);
  }
  Vec3d vector(const SortedJson& value, const char* key) const {
    if (!value.is_array() || value.size() != 3)
      fail(fmt::format("has no three numbers in {}", key));
    return {precise(value[0], key), precise(value[1], key), precise(value[2], key)};
  }
  Vec3d position() const { return vector(at("position"), "position"); }

  /// The rotation of cam_from_world, from the rows of world_from_cam.
  Mat3<float> rotation() const {
    const SortedJson& rows = at("rotation");
    if (!rows.is_array() || rows.size() != 3) fail("has no three rows in rotation");
    const Vec3f a(vector(rows[0], "rotation")), b(vector(rows[1], "rotation")),
        c(vector(rows[2], "rotation"));
    const Mat3<float> R{{a.x, b.x, c.x}, {a.y, b.y, c.y}, {a.z, b.z, c.z}};
    if (!is_rotation(R, kRotationTolerance)) fail("has a rotation that is not a rotation matrix");
    return R;
  }

  CameraLens<float> lens(const SortedJson& json) const {
    CameraLens<float> result = endless_lens<float>(Lens::none);
    for (const LensWord& known : kLensWords)
      if (json.is_object() && json.value("kind", SortedJson()) == known.word)
        result.lens = known.lens;
    if (result.lens == Lens::none) fail("has no lens that is known as lens.kind");
    for_each_lens_key(result, [&](const char* key, float* numbers, int count) {
      const auto found = json.find(key);
      if (found == json.end()) return;
      if (!found->is_array() || found->size() != std::size_t(count))
        fail(fmt::format("has no {} numbers in lens.{}", count, key));
      for (int i = 0; i < count; ++i) numbers[i] = number((*found)[std::size_t(i)], key);
    });
    if (!(result.radius > 0)) fail("has a lens.radius that is not above 0");
    if (result.motion.is_any() && !(result.rows.x < result.rows.y))
      fail("has a lens that moves from no row to another in lens.rows");
    if (has_angle_chart(result.lens)) result.radius = std::min(result.radius, float(kLargestAngle));
    return result;
  }

  const SortedJson& json_;
  std::size_t index_;
  const std::filesystem::path& path_;
};

void place(Camera& camera, const Vec3d& position) {
  const Mat3<float>& R = camera.cam_from_world_rotation;
  const Mat3<double> R_double{Vec3d(R.row0), Vec3d(R.row1), Vec3d(R.row2)};
  camera.cam_from_world_translation = Vec3f(-multiply(R_double, position));
}

}  // namespace

const char* word_of(Lens lens) {
  return std::ranges::find(kLensWords, lens, &LensWord::lens)->word;
}

void write_cameras_json(const std::filesystem::path& path, const Scene& scene) {
  std::vector<NamedCamera> cameras;
  for (const auto* views : {&scene.test_views, &scene.train_views})
    for (const View& view : *views) cameras.push_back({without_extension(view.name), view.camera});
  write_cameras_json(path, cameras);
}

void write_cameras_json(const std::filesystem::path& path,
                        const std::vector<NamedCamera>& cameras) {
  std::string text = "[";
  for (std::size_t id = 0; id < cameras.size(); ++id) {
    text += id ? ",\n" : "\n";
    text += camera_line(cameras[id].name, cameras[id].camera, id);
  }
  AtomicFile file(path);
  file.write(text + "\n]\n");
  file.commit();
}

std::vector<NamedCamera> read_cameras_json(const std::filesystem::path& path,
                                           const Vec3d& world_offset) {
  const SortedJson json = read_json_as<SortedJson>(path, "write it again");
  if (!json.is_array()) {
    cannot_read(path, "it is not a list of cameras; name a cameras.json that a trainer wrote");
  }
  return cameras_of_json(json, path, world_offset);
}

std::vector<NamedCamera> cameras_of_json(const SortedJson& json, const std::filesystem::path& path,
                                         const Vec3d& world_offset) {
  std::vector<NamedCamera> cameras;
  std::vector<Vec3d> positions;
  for (std::size_t i = 0; i < json.size(); ++i) {
    auto [camera, position] = CameraReader(json[i], i, path).read();
    cameras.push_back(std::move(camera));
    positions.push_back(position);
  }
  const bool is_far = are_nearer_to(world_offset, positions);
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    place(cameras[i].camera, is_far ? positions[i] - world_offset : positions[i]);
    if (!is_finite(cameras[i].camera.position()))
      cannot_read(path, fmt::format("the position of camera {} of the list does not fit single "
                                    "precision; correct the entry or write the file again",
                                    i));
  }
  return cameras;
}

}  // namespace gs
