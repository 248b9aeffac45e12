// SPDX-License-Identifier: Apache-2.0
// Stages, in order: parse, read each frame's name, camera and pose, split, read the points. A table
// of what the keys mean is in the header. Longer than most files for the faults that it names.
#include "data_loaders/scene/transforms_json.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <tuple>
#include <unordered_set>

#include "data_loaders/formats/ply/ply_file.h"
#include "data_loaders/photos/photos.h"
#include "gs_core/error.h"
#include "gs_core/geometry.h"
#include "gs_core/io/byte_reader.h"
#include "gs_core/log.h"
#include "gs_core/math/quaternion.h"
#include "gs_core/math/rotation.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Names = std::unordered_set<std::string>;

// Bytes, some 100,000 frames. Parsed, a file takes up to some 20 times its size.
constexpr std::uint64_t kLargestFile = std::uint64_t(128) << 20;
constexpr int kLongestSide = 65520;          // pixels; a JPEG's most in whole blocks of 16
constexpr double kRotationTolerance = 0.01;  // files with three digits pass, scaled matrices do not
constexpr float kGray = 128;                 // of points without color

constexpr const char* kOneFile = "transforms.json";
constexpr const char* kTrainFile = "transforms_train.json";

bool is_file(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

// --- Files

/// A file that has been parsed: an object with a list of frames that is not empty.
struct TransformsFile {
  fs::path path;
  Json top;

  fs::path folder() const { return path.parent_path(); }
  const Json& frames() const { return *top.find("frames"); }
  [[noreturn]] void fail(const std::string& what) const { cannot_read(path, what); }
};

Json parse_file(const fs::path& path) {
  ByteReader reader(path);
  if (reader.size() > kLargestFile)
    cannot_read(path, fmt::format("it has {} bytes, too many for a list of cameras; cut the scene "
                                  "into smaller ones",
                                  reader.size()));
  const auto size = std::size_t(reader.size());
  const auto* text = reinterpret_cast<const char*>(reader.take(size));
  try {
    return Json::parse(text, text + size);
  } catch (const Json::parse_error& error) {
    cannot_read(path, fmt::format("it is no JSON from byte {} on (which cannot say NaN or "
                                  "Infinity); it is cut short or damaged, write it again",
                                  error.byte));
  } catch (const Json::exception&) {
    cannot_read(path, "it holds a number that is not finite; mend it or write the file again");
  }
}

TransformsFile open_file(const fs::path& path) {
  TransformsFile file{path, parse_file(path)};
  const auto frames = file.top.is_object() ? file.top.find("frames") : file.top.end();
  if (!file.top.is_object() || frames == file.top.end() || !frames->is_array() || frames->empty())
    file.fail(
        "it has no list \"frames\" with a frame in it; name a file that nerfstudio, instant-ngp or "
        "Blender wrote");
  return file;
}

// --- Names

/// A path relative to the folder of the file that names it, with "/" between folders and without
/// "./"; nothing where it is absolute, leads out of the folder or is no file's.
std::optional<std::string> path_inside(std::string name) {
  std::replace(name.begin(), name.end(), '\\', '/');  // written on Windows
  const bool has_drive = name.size() > 2 && name[1] == ':' && name[2] == '/';
  if (name.empty() || name.find('\0') != name.npos || has_drive) return std::nullopt;
  const fs::path path = fs::path(name).lexically_normal();
  const fs::path last = path.filename();
  if (path.is_absolute() || *path.begin() == ".." || last.empty() || last == ".")
    return std::nullopt;
  return path.generic_string();
}

/// The name of a file that exists: Blender's files leave the extension out. The name itself where
/// there is none.
std::string with_extension(const fs::path& folder, const std::string& name) {
  if (is_file(folder / name)) return name;
  for (const char* extension : {".png", ".jpg", ".jpeg"})
    if (is_file(folder / (name + extension))) return name + extension;
  return name;
}

// --- Rotations

/// What is wrong with the axes of a camera; "" if they are a rotation.
std::string fault_of(const Mat3<double>& R) {
  switch (rotation_fault(R, kRotationTolerance)) {
    case RotationFault::none: return "";
    case RotationFault::scales:
      return fmt::format("scales the camera's axes by {:.4g}, {:.4g} and {:.4g}", length(R.row0),
                         length(R.row1), length(R.row2));
    case RotationFault::shears: return "shears: the camera's axes are not at right angles";
    case RotationFault::mirrors: return "mirrors: the camera's axes are left-handed";
  }
  return "";
}

// --- Frames

/// One frame of a file; knows where it stands for error messages.
class FrameReader {
 public:
  FrameReader(const TransformsFile& file, std::size_t index)
      : file_(file), frame_(file.frames()[index]), place_(fmt::format("frame {}", index)) {
    if (!frame_.is_object()) fail("is no object");
    const Json* path = value_of(frame_, "file_path");
    if (path && path->is_string()) place_ += fmt::format(" ('{}')", path->get_ref<const Text&>());
  }

  std::string name() const {
    const Json* path = value_of(frame_, "file_path");  // not the top's
    if (!path) fail("lacks file_path");
    const auto name = path_inside(text(*path, "file_path"));
    if (!name)
      fail(
          "has a file_path that is empty, absolute, a folder or leads out of the file's folder; "
          "copy the photos below that folder and name them relative to it",
          "");
    return with_extension(file_.folder(), *name);
  }

  /// Of the photo, relative to the file's folder as file_path is; empty where none is named.
  fs::path mask() const {
    const Json* path = value_of(frame_, "mask_path");  // not the top's
    if (!path || path->is_null()) return {};
    const auto name = path_inside(text(*path, "mask_path"));
    if (!name)
      fail(
          "has a mask_path that is empty, absolute, a folder or leads out of the file's folder; "
          "copy the masks below that folder and name them relative to it",
          "");
    const fs::path mask = file_.folder() / *name;
    if (!fs::is_regular_file(mask))
      fail(fmt::format("names the mask {}, which is not there; copy it there, or leave mask_path "
                       "out",
                       mask.string()),
           "");
    return mask;
  }

  /// Without id. `name` is that of the photo.
  ColmapCamera camera(const std::string& name) const {
    ColmapCamera camera;
    const PhotoSize size = picture_size(name);
    camera.width = size.width;
    camera.height = size.height;
    const std::string model = model_name();
    if (model == "EQUIRECTANGULAR") {
      camera.model = CameraModel::equirectangular;
      camera.params = {double(size.width), double(size.height)};
      return camera;
    }
    const auto fx = focal_length("fl_x", "camera_angle_x", size.width);
    const auto fy = focal_length("fl_y", "camera_angle_y", size.height);
    if (!fx && !fy) fail("lacks fl_x, or camera_angle_x, and so does the top of the file");
    camera.params = {fx ? *fx : *fy, fy ? *fy : *fx, number_or("cx", 0.5 * size.width),
                     number_or("cy", 0.5 * size.height)};
    add_lens(model, camera);
    return camera;
  }

  /// cam_from_world of OpenCV's axes is the inverse of transform_matrix * diag(1, -1, -1, 1), whose
  /// rotation has the camera's axes in its columns.
  void read_pose(ColmapImage& image) const {
    const Json* rows = value_of(frame_, "transform_matrix");
    if (!rows) fail("lacks transform_matrix");
    if (!rows->is_array() || (rows->size() != 3 && rows->size() != 4)) fail_matrix();
    const Vec4<double> a = row((*rows)[0]), b = row((*rows)[1]), c = row((*rows)[2]);
    if (rows->size() == 4 && row((*rows)[3]) != Vec4<double>(0, 0, 0, 1))
      fail("has a transform_matrix whose last row is not 0 0 0 1");
    const Mat3<double> R{{a.x, b.x, c.x}, {-a.y, -b.y, -c.y}, {-a.z, -b.z, -c.z}};
    const std::string fault = fault_of(R);
    if (!fault.empty())
      fail("has a transform_matrix that " + fault +
               "; write it again with rotations and translations alone",
           "");
    image.cam_from_world_rotation = quaternion_of(R);
    image.cam_from_world_translation =
        -multiply(rotation_matrix(image.cam_from_world_rotation), Vec3d(a.w, b.w, c.w));
    if (!is_finite(image.cam_from_world_translation))
      fail("has a translation in transform_matrix that is not finite");
  }

 private:
  using Text = std::string;

  [[noreturn]] void fail(const std::string& what,
                         const char* remedy = "; mend the entry or write the file again") const {
    file_.fail(fmt::format("{} {}{}", place_, what, remedy));
  }
  [[noreturn]] void fail_matrix() const {
    fail("has a transform_matrix that is not 4 rows of 4 numbers");
  }

  /// Null stands for a key that is not there.
  static const Json* value_of(const Json& level, const char* key) {
    const auto found = level.find(key);
    return found == level.end() || found->is_null() ? nullptr : &*found;
  }
  /// The frame's own value, or the one at the top of the file, or nullptr.
  const Json* find(const char* key) const {
    const Json* own = value_of(frame_, key);
    return own ? own : value_of(file_.top, key);
  }
  const Text& text(const Json& value, const char* key) const {
    if (!value.is_string()) fail(fmt::format("has {} as {}, not text", kind(value), key));
    return value.get_ref<const Text&>();
  }
  double number(const Json& value, const char* key) const {
    if (!value.is_number()) fail(fmt::format("has {} as {}, not a number", kind(value), key));
    return value.get<double>();
  }
  double number_or(const char* key, double otherwise) const {
    const Json* value = find(key);
    return value ? number(*value, key) : otherwise;
  }
  static std::string kind(const Json& value) {
    return fmt::format("a value of type {}", value.type_name());
  }

  Vec4<double> row(const Json& value) const {
    if (!value.is_array() || value.size() != 4) fail_matrix();
    const auto at = [&](int i) { return number(value[i], "an entry of transform_matrix"); };
    return {at(0), at(1), at(2), at(3)};
  }

  // Intrinsics

  std::string model_name() const {
    if (const Json* model = find("camera_model")) return text(*model, "camera_model");
    const Json* fisheye = find("is_fisheye");
    return fisheye && fisheye->is_boolean() && fisheye->get<bool>() ? "OPENCV_FISHEYE" : "OPENCV";
  }

  int side(double pixels, const char* key) const {
    if (!(pixels >= 1 && pixels <= kLongestSide) || pixels != std::floor(pixels))
      fail(fmt::format("has {} as {}, which must be a whole number of pixels from 1 to {}", pixels,
                       key, kLongestSide));
    return int(pixels);
  }
  PhotoSize picture_size(const std::string& name) const {
    const Json *w = find("w"), *h = find("h");
    if (w && h) return {side(number(*w, "w"), "w"), side(number(*h, "h"), "h")};
    if (w || h) fail(fmt::format("has {} without {}", w ? "w" : "h", w ? "h" : "w"));
    PhotoSize size;
    try {
      size = read_photo_size(file_.folder() / name);
    } catch (const Error& error) {
      fail(fmt::format("lacks w and h, and its photo cannot tell them: {}", error.what()), "");
    }
    return {side(size.width, "its photo's width"), side(size.height, "its photo's height")};
  }

  double positive(const Json& value, const char* key, double below) const {
    const double result = number(value, key);
    if (!(result > 0 && result < below))
      fail(fmt::format("has {} as {}, which must be above 0{}", result, key,
                       std::isfinite(below) ? fmt::format(" and below {:.5g}", below) : ""));
    return result;
  }
  /// In pixels: as it is given, or from the angle across the picture's side; the frame's own before
  /// the top's. Nothing where neither has any.
  std::optional<double> focal_length(const char* key, const char* angle_key, int side) const {
    for (const Json* level : {&frame_, &file_.top}) {
      if (const Json* pixels = value_of(*level, key)) return positive(*pixels, key, INFINITY);
      if (const Json* angle = value_of(*level, angle_key)) {
        const double radians = positive(*angle, angle_key, std::numbers::pi);
        const double pixels = 0.5 * side / std::tan(0.5 * radians);
        if (!std::isfinite(pixels))
          fail(fmt::format("has {} as {}: too small", radians, angle_key));
        return pixels;
      }
    }
    return std::nullopt;
  }

  /// Sets the model and appends the coefficients of the lens.
  void add_lens(const std::string& model, ColmapCamera& camera) const {
    const auto k = [&](const char* key) { return number_or(key, 0); };
    const auto append = [&](CameraModel as, std::initializer_list<double> coefficients) {
      camera.model = as;
      camera.params.insert(camera.params.end(), coefficients);
    };
    if (model == "OPENCV_FISHEYE") {
      expect_zero(model, {"p1", "p2", "k5", "k6"});
      return append(CameraModel::opencv_fisheye, {k("k1"), k("k2"), k("k3"), k("k4")});
    }
    if (model == "PINHOLE" || model == "SIMPLE_PINHOLE") {
      expect_zero(model, {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"});
      return append(CameraModel::pinhole, {});
    }
    if (model != "OPENCV")
      fail("has the camera_model " + model +
               ", which gemsplat does not know; undistort the photos and write OPENCV, "
               "OPENCV_FISHEYE, PINHOLE, SIMPLE_PINHOLE or EQUIRECTANGULAR",
           "");
    // The fourth is a radial one for nerfstudio and one below the line for OpenCV.
    expect_zero(model, {"k4", "k5", "k6"});
    const double k1 = k("k1"), k2 = k("k2"), p1 = k("p1"), p2 = k("p2"), k3 = k("k3");
    if (k3 != 0) return append(CameraModel::full_opencv, {k1, k2, p1, p2, k3, 0, 0, 0});
    if (k1 != 0 || k2 != 0 || p1 != 0 || p2 != 0)
      return append(CameraModel::opencv, {k1, k2, p1, p2});
    append(CameraModel::pinhole, {});
  }
  void expect_zero(const std::string& model, std::initializer_list<const char*> keys) const {
    for (const char* key : keys)
      if (number_or(key, 0) != 0)
        fail(fmt::format("has {} as {}, which the camera_model {} does not have here; name the "
                         "right camera_model, or undistort the photos",
                         number_or(key, 0), key, model),
             "");
  }

  const TransformsFile& file_;
  const Json& frame_;
  std::string place_;
};

/// Puts frames into a model, whose folder is set.
class FrameCollector {
 public:
  explicit FrameCollector(ColmapModel& model) : model_(model) {}

  void add_frames(const TransformsFile& file) {
    for (std::size_t i = 0; i < file.frames().size(); ++i) {
      const FrameReader frame(file, i);
      ColmapImage image;
      image.id = std::uint32_t(model_.images.size() + 1);
      image.name = frame.name();
      image.mask = frame.mask();
      if (!names_.insert(image.name).second)
        file.fail(
            fmt::format("file_path of frame {} is '{}', which a frame before it has; leave one out",
                        i, image.name));
      image.camera_id = id_of(frame.camera(image.name));
      frame.read_pose(image);
      model_.images.push_back(std::move(image));
    }
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
  std::map<std::tuple<CameraModel, int, int, std::vector<double>>, std::uint32_t> ids_;
};

// --- Split

/// The photos that a list at the top of the file names; nothing where there is no such list.
std::optional<Names> listed(const TransformsFile& file, const char* key, const Names& known) {
  const auto list = file.top.find(key);
  if (list == file.top.end() || list->is_null()) return std::nullopt;
  if (!list->is_array())
    file.fail(fmt::format("{} is no list; list file_paths in it or leave it out", key));
  Names names;
  for (std::size_t i = 0; i < list->size(); ++i) {
    const Json& entry = (*list)[i];
    const std::string text = entry.is_string() ? entry.get<std::string>() : "";
    const std::string name = with_extension(file.folder(), path_inside(text).value_or(""));
    if (!known.contains(name))
      file.fail(
          fmt::format("entry {} of {}, '{}', is the file_path of no frame; mend it or leave "
                      "it out",
                      i, key, text));
    names.insert(name);
  }
  return names;
}

/// Splits the images as nerfstudio's lists say, where there are any; drops those without use.
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
    log_warning("{} photos are for training and for testing in {}: they are not trained on",
                in_both, file.path.string());
  if (scene.test_names.size() == scene.model.images.size())
    file.fail("train_filenames and test_filenames leave no frame to train on; mend the lists");
}

// --- Points

/// One color value as a byte; files have it from 0 to 255, or from 0 to 1 as float.
std::uint8_t color_byte(float value, PlyType type) {
  const bool is_real = type == PlyType::float32 || type == PlyType::float64;
  const float scaled = is_real ? 255 * value : value;
  return scaled > 0 ? std::uint8_t(std::min(std::round(scaled), 255.0f)) : 0;
}

std::vector<ColmapPoint> read_points(const fs::path& path) {
  PlyFile file(path);
  const PlyElement* vertex = file.header().find("vertex");
  std::vector<Vec3f> positions, colors;
  std::vector<PlyColumn> columns;
  const auto add = [&](const char* name, std::vector<Vec3f>& to, std::size_t offset) {
    columns.push_back({name, reinterpret_cast<float*>(to.data()), offset, 3});
  };
  for (const char* name : {"x", "y", "z"})
    if (!vertex || vertex->find(name) < 0)
      cannot_read(path, fmt::format("its points have no {}; export it again", name));
  positions.resize(vertex->count);
  add("x", positions, 0), add("y", positions, 1), add("z", positions, 2);
  const int red = vertex->find("red");
  const bool has_colors = red >= 0 && vertex->find("green") >= 0 && vertex->find("blue") >= 0;
  colors.assign(vertex->count, Vec3f(kGray));
  if (has_colors) add("red", colors, 0), add("green", colors, 1), add("blue", colors, 2);
  file.read_columns(*vertex, columns);

  const PlyType type = has_colors ? vertex->properties[red].type : PlyType::uint8;
  std::vector<ColmapPoint> points;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (!is_finite(positions[i])) continue;
    const Vec3f& c = colors[i];
    points.push_back({points.size() + 1,
                      Vec3d(positions[i]),
                      {color_byte(c.x, type), color_byte(c.y, type), color_byte(c.z, type)}});
  }
  if (points.size() < positions.size())
    log_warning("{} of {} points in {} have a position that is not finite: left out",
                positions.size() - points.size(), positions.size(), path.string());
  return points;
}

void add_points(const TransformsFile& file, ColmapModel& model) {
  const auto entry = file.top.find("ply_file_path");
  if (entry == file.top.end() || entry->is_null()) return;
  const auto name = entry->is_string() ? path_inside(entry->get<std::string>()) : std::nullopt;
  if (!name)
    file.fail(
        "ply_file_path is no path to a file in its folder; copy the PLY there and name it relative "
        "to the folder, or leave the key out");
  try {
    model.points = read_points(file.folder() / *name);
  } catch (const Error& error) {
    log_warning("{}; going on without points", error.what());
  }
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
  const TransformsFile first = open_file(folder / (is_one_file ? kOneFile : kTrainFile));
  collector.add_frames(first);
  if (is_one_file) split_by_lists(first, scene);
  for (const char* name : {"transforms_test.json", "transforms_val.json"}) {
    if (is_one_file || scene.has_split || !is_file(folder / name)) continue;
    const std::size_t train_count = scene.model.images.size();
    collector.add_frames(open_file(folder / name));
    for (std::size_t i = train_count; i < scene.model.images.size(); ++i)
      scene.test_names.push_back(scene.model.images[i].name);
    scene.has_split = true;
  }
  add_points(first, scene.model);
  return scene;
}

ColmapModel read_transforms_file(const fs::path& file) {
  ColmapModel model;
  model.folder = file.parent_path();
  FrameCollector(model).add_frames(open_file(file));
  return model;
}

}  // namespace gs
