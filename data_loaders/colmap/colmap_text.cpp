// SPDX-License-Identifier: Apache-2.0
// cameras.txt, images.txt, points3D.txt, rigs.txt and frames.txt: one record a line, '#' begins a
// comment line (COLMAP, doc/format.rst). Other programs write these files too, so CRLF, tabs, empty
// lines and missing POINTS2D lines are taken as they come.
//
//   cameras.txt   CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]
//   images.txt    IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME     (NAME is the rest of the line)
//                 POINTS2D[] as (X Y POINT3D_ID)                   (may be empty)
//   points3D.txt  POINT3D_ID X Y Z R G B ERROR TRACK[]
//   rigs.txt      RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID
//                 SENSORS[] as (SENSOR_TYPE SENSOR_ID HAS_POSE [QW QX QY QZ TX TY TZ])
//   frames.txt    FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA_IDS
//                 DATA_IDS[] as (SENSOR_TYPE SENSOR_ID DATA_ID)    (of a camera: an image id)
#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <cmath>

#include "data_loaders/colmap/colmap_files.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/ascii.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs::colmap {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kBlanks = " \t\r";

/// Cuts the next word off the front of `line`; empty at the end.
std::string_view next_word(std::string_view& line) {
  line = trimmed(line);
  const std::size_t length = std::min(line.find_first_of(kBlanks), line.size());
  const std::string_view word = line.substr(0, length);
  line.remove_prefix(length);
  return word;
}

/// Whether the whole word is one number; if so, sets `value`.
template <class T>
bool parse(std::string_view word, T& value) {
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size() && !word.empty();
}

/// A text file that is read line by line and knows where it stands.
class TextFile {
 public:
  explicit TextFile(const fs::path& path) : path_(path), bytes_(path) {}

  /// The next line, trimmed; false at the end.
  bool next_line(std::string_view& line) {
    if (bytes_.left() == 0) return false;
    ++line_number_;
    if (const auto whole = bytes_.take_line()) {
      line = trimmed(*whole);
    } else {  // the last one may lack its line feed
      const auto left = std::size_t(bytes_.left());
      line = trimmed({reinterpret_cast<const char*>(bytes_.take(left)), left});
    }
    return true;
  }
  /// The next line that is neither empty nor a comment.
  bool next_record(std::string_view& line) {
    while (next_line(line))
      if (!line.empty() && line[0] != '#') return true;
    return false;
  }

  /// Cuts a number off the front of `line`; `what` names it in the complaint.
  template <class T>
  T take(std::string_view& line, const char* what) {
    T value{};
    const std::string_view word = next_word(line);
    if (word.empty()) fail(fmt::format("{} is missing", what));
    if (!parse(word, value))
      fail(fmt::format("{} is '{}', which is not a {}", what, shown_word(word), kind_of(value)));
    return value;
  }

  void expect_good(const std::string& fault) const {
    if (!fault.empty()) fail(fault);
  }
  [[noreturn]] void fail(const std::string& what) const {
    colmap::fail(path_, fmt::format("{} in line {}", what, line_number_));
  }

 private:
  static const char* kind_of(double) { return "number"; }
  static const char* kind_of(std::uint64_t) { return "whole number"; }
  static const char* kind_of(std::uint32_t) { return "whole number"; }
  static const char* kind_of(std::uint8_t) { return "whole number from 0 to 255"; }

  fs::path path_;
  ByteReader bytes_;
  std::uint64_t line_number_ = 0;
};

/// Whether a line that stands where POINTS2D belongs is the next image: nine numbers, then a name,
/// or a tenth number that ends the line, for points come in threes.
bool is_image_line(std::string_view line) {
  double number;
  for (int i = 0; i < 9; ++i)
    if (!parse(next_word(line), number)) return false;
  const std::string_view name = next_word(line);
  return !name.empty() && (!parse(name, number) || trimmed(line).empty());
}

/// Calls `visit` with every line of images.txt that has an image, and `visit_points` with the
/// POINTS2D that follow it, where they do.
template <class Visit, class VisitPoints>
void for_each_image_line(TextFile& file, Visit visit, VisitPoints visit_points) {
  std::string_view line;
  bool has_record = file.next_record(line);
  while (has_record) {
    visit(line);
    // POINTS2D stands in the next line, which may be empty; if an image stands there, it was left
    // out.
    if (!file.next_line(line)) break;
    has_record = is_image_line(line);
    if (has_record) continue;
    visit_points(line);
    has_record = file.next_record(line);
  }
}

Quat<double> take_quaternion(TextFile& file, std::string_view& line) {
  Quat<double> q;
  for (double* part : {&q.w, &q.x, &q.y, &q.z}) *part = file.take<double>(line, "the rotation");
  return q;
}

Vec3d take_vector(TextFile& file, std::string_view& line, const char* what) {
  Vec3d v;
  v.x = file.take<double>(line, what);
  v.y = file.take<double>(line, what);
  v.z = file.take<double>(line, what);
  return v;
}

/// COLMAP writes names of sensors; some programs write its numbers.
bool is_camera_sensor(std::string_view kind) {
  return kind == "CAMERA" || kind == std::to_string(kCameraSensor);
}

ColmapImage parse_image(TextFile& file, std::string_view line) {
  ColmapImage image;
  image.id = file.take<std::uint32_t>(line, "IMAGE_ID");
  image.cam_from_world_rotation = take_quaternion(file, line);
  image.cam_from_world_translation = take_vector(file, line, "the translation");
  image.camera_id = file.take<std::uint32_t>(line, "CAMERA_ID");
  image.name = trimmed(line);
  return image;
}

/// POINTS2D[] as (X Y POINT3D_ID); -1 for a 2D point without a point.
std::vector<ColmapObservation> parse_observations(TextFile& file, std::string_view line) {
  std::vector<ColmapObservation> observations;
  while (!trimmed(line).empty()) {
    ColmapObservation at;
    at.x = file.take<double>(line, "X of a 2D point");
    at.y = file.take<double>(line, "Y of a 2D point");
    const std::string_view word = next_word(line);
    const bool is_point = parse(word, at.point_id) && at.point_id != kNoPoint;
    if (is_point && std::isfinite(at.x) && std::isfinite(at.y)) observations.push_back(at);
  }
  return observations;
}

}  // namespace

void read_text_cameras(const fs::path& path, ModelBuilder& model) {
  TextFile file(path);
  for (std::string_view line; file.next_record(line);) {
    ColmapCamera camera;
    camera.id = file.take<std::uint32_t>(line, "CAMERA_ID");
    const std::string_view name = next_word(line);
    const auto known = camera_model_of(name);
    if (!known)
      file.fail(
          fmt::format("camera {} has the unknown camera model '{}'", camera.id, shown_word(name)));
    camera.model = *known;
    const auto width = file.take<std::uint64_t>(line, "WIDTH");
    const auto height = file.take<std::uint64_t>(line, "HEIGHT");
    while (!trimmed(line).empty()) camera.params.push_back(file.take<double>(line, "a parameter"));
    const int wanted = camera_model_info(camera.model).param_count;
    if (int(camera.params.size()) != wanted)
      file.fail(fmt::format("camera {} is {}, which has {} parameters, but gives {}", camera.id,
                            name, wanted, camera.params.size()));
    file.expect_good(model.add_camera(std::move(camera), width, height));
  }
}

std::uint64_t count_text_images(const fs::path& path) {
  TextFile file(path);
  std::uint64_t count = 0;
  for_each_image_line(
      file, [&](std::string_view) { ++count; }, [](std::string_view) {});
  return count;
}

void read_text_images(const fs::path& path, ModelBuilder& model) {
  TextFile file(path);
  for_each_image_line(
      file,
      [&](std::string_view line) { file.expect_good(model.add_image(parse_image(file, line))); },
      [&](std::string_view line) {
        if (model.wants_observations() && !line.starts_with('#'))
          model.add_observations(parse_observations(file, line));
      });
}

void read_text_points(const fs::path& path, ModelBuilder& model) {
  TextFile file(path);
  for (std::string_view line; file.next_record(line);) {
    ColmapPoint point;
    point.id = file.take<std::uint64_t>(line, "POINT3D_ID");
    point.position = take_vector(file, line, "the position");
    for (std::uint8_t& channel : point.color) channel = file.take<std::uint8_t>(line, "the color");
    if (!trimmed(line).empty()) point.error = file.take<double>(line, "the error");
    while (!next_word(line).empty() && !next_word(line).empty()) ++point.observations;
    model.add_point(point);
  }
}

void read_text_rigs(const fs::path& path, ModelBuilder& model) {
  TextFile file(path);
  for (std::string_view line; file.next_record(line);) {
    ColmapRig rig;
    rig.id = file.take<std::uint32_t>(line, "RIG_ID");
    const auto sensors = file.take<std::uint32_t>(line, "NUM_SENSORS");
    for (std::uint32_t k = 0; k < sensors; ++k) {
      const std::string_view kind = next_word(line);
      ColmapRigCamera camera;
      camera.camera_id = file.take<std::uint32_t>(line, "SENSOR_ID");
      const bool is_reference = k == 0;
      camera.has_pose = is_reference || file.take<std::uint32_t>(line, "HAS_POSE") != 0;
      if (camera.has_pose && !is_reference) {
        camera.cam_from_rig_rotation = take_quaternion(file, line);
        camera.cam_from_rig_translation = take_vector(file, line, "the translation");
      }
      if (is_camera_sensor(kind)) rig.cameras.push_back(camera);
    }
    file.expect_good(model.add_rig(std::move(rig)));
  }
}

void read_text_frames(const fs::path& path, ModelBuilder& model) {
  TextFile file(path);
  for (std::string_view line; file.next_record(line);) {
    ColmapFrame frame;
    frame.id = file.take<std::uint32_t>(line, "FRAME_ID");
    frame.rig_id = file.take<std::uint32_t>(line, "RIG_ID");
    take_quaternion(file, line);  // every image has its own pose
    take_vector(file, line, "the translation");
    const auto data = file.take<std::uint32_t>(line, "NUM_DATA_IDS");
    for (std::uint32_t k = 0; k < data; ++k) {
      const std::string_view kind = next_word(line);
      file.take<std::uint32_t>(line, "SENSOR_ID");
      const auto id = file.take<std::uint64_t>(line, "DATA_ID");
      if (is_camera_sensor(kind)) frame.image_ids.push_back(id);
    }
    file.expect_good(model.add_frame(std::move(frame)));
  }
}

}  // namespace gs::colmap
