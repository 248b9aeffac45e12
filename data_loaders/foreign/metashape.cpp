// SPDX-License-Identifier: Apache-2.0
// cameras.xml of Metashape: sensors, cameras with their poses in a chunk's coordinates, and the
// transforms of its components to the world.
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <map>
#include <pugixml.hpp>
#include <sstream>

#include "data_loaders/foreign/foreign_model.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

constexpr std::uint64_t kMostXml = 1 << 28;  // bytes
constexpr double kMostSkew = 0.5;  // pixels by which a skew that is left out moves a border

std::vector<double> numbers_of(const ForeignModel& model, const pugi::xml_node& node,
                               std::size_t count) {
  std::istringstream words(node.child_value());
  std::vector<double> numbers;
  for (std::string word; words >> word;) {
    double value = 0;
    if (!parse_number(word, value)) break;
    numbers.push_back(value);
  }
  if (numbers.size() != count)
    model.fail(
        fmt::format("a <{}> has not {} numbers; export the cameras again", node.name(), count));
  return numbers;
}

[[noreturn]] void refuse_sensor(const ForeignModel& model, const pugi::xml_node& sensor,
                                const std::string& what) {
  model.fail(fmt::format("its sensor '{}' {}; export the photos undistorted, with their cameras",
                         sensor.attribute("label").value(), what));
}

std::uint32_t camera_of_sensor(ForeignModel& model, const pugi::xml_node& sensor) {
  const pugi::xml_node resolution = sensor.child("resolution");
  const PhotoSize size{resolution.attribute("width").as_int(),
                       resolution.attribute("height").as_int()};
  const std::string type = sensor.attribute("type").value();
  if (type == "spherical")
    return model.camera(CameraModel::equirectangular, size,
                        {double(size.width), double(size.height)});
  pugi::xml_node calibration = sensor.find_child_by_attribute("calibration", "class", "adjusted");
  if (!calibration) calibration = sensor.child("calibration");
  if (!calibration) refuse_sensor(model, sensor, "has no calibration");
  const auto number = [&](const char* name) { return calibration.child(name).text().as_double(); };
  if (!(number("f") > 0))
    refuse_sensor(model, sensor, "has no focal length f, as files of PhotoScan 1.2 and older");
  // A skew moves the upper and the lower border of a photo against each other.
  if (std::abs(number("b2")) * 0.5 * size.height > kMostSkew * number("f"))
    refuse_sensor(model, sensor, "has a skew (b2) of more than half a pixel");
  const double fx = number("f") + number("b1"), fy = number("f");
  const double cx = number("cx") + 0.5 * size.width, cy = number("cy") + 0.5 * size.height;
  if (type == "frame" || type.empty())  // p1 and p2 are the other way round
    return model.camera(size, {fx, fy, cx, cy, number("k1"), number("k2"), number("k3"),
                               number("k4"), number("p2"), number("p1")});
  if (type != "fisheye" && type != "equidistant_fisheye")
    refuse_sensor(model, sensor, "is of the type " + type);
  if (number("p1") != 0 || number("p2") != 0)
    refuse_sensor(model, sensor, "is a fisheye with p1 or p2");
  return model.camera(CameraModel::opencv_fisheye, size,
                      {fx, fy, cx, cy, number("k1"), number("k2"), number("k3"), number("k4")});
}

/// world = scale R x + t
struct ToWorld {
  double scale = 1;
  Mat3<double> R{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  Vec3d t{0.0, 0.0, 0.0};
};

ToWorld to_world_of(const ForeignModel& model, const pugi::xml_node& transform) {
  ToWorld result;
  if (const auto rotation = transform.child("rotation"))
    result.R = matrix_of_rows(numbers_of(model, rotation, 9));
  if (const auto translation = transform.child("translation")) {
    const auto t = numbers_of(model, translation, 3);
    result.t = {t[0], t[1], t[2]};
  }
  if (const auto scale = transform.child("scale")) result.scale = numbers_of(model, scale, 1)[0];
  if (!(result.scale > 0)) model.fail("a transform has no scale above 0; export it again");
  return result;
}

Mat3<double> product(const Mat3<double>& a, const Mat3<double>& b) {
  const Mat3<double> t = transposed(b);
  const auto row = [&](const Vec3d& r) {
    return Vec3d(inner(r, t.row0), inner(r, t.row1), inner(r, t.row2));
  };
  return {row(a.row0), row(a.row1), row(a.row2)};
}

/// Calls visit for each camera, also those in groups.
template <class Visit>
void for_each_camera(const pugi::xml_node& cameras, const Visit& visit) {
  for (const pugi::xml_node& child : cameras) {
    if (std::string_view(child.name()) == "camera") visit(child);
    if (std::string_view(child.name()) == "group")
      for (const pugi::xml_node& camera : child.children("camera")) visit(camera);
  }
}

}  // namespace

void read_metashape(ForeignModel& model) {
  const std::string text = read_text_file(model.file(), kMostXml);
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer(text.data(), text.size());
  if (!parsed)
    model.fail(fmt::format("it is no XML at byte {} ({}); export the cameras again", parsed.offset,
                           parsed.description()));
  const pugi::xml_node chunk = document.child("document").child("chunk");
  std::map<std::string, ToWorld> components;
  for (const pugi::xml_node& component : chunk.child("components").children("component"))
    if (const auto transform = component.child("transform"))
      components[component.attribute("id").value()] = to_world_of(model, transform);
  const ToWorld of_chunk = to_world_of(model, chunk.child("transform"));
  std::vector<std::string> of_rigs;
  for_each_camera(chunk.child("cameras"), [&](const pugi::xml_node& camera) {
    const auto transform = camera.child("transform");
    if (!transform) {  // not placed, or by another camera of its rig
      if (camera.attribute("master_id")) of_rigs.push_back(camera.attribute("label").value());
      return;
    }
    const auto photo = model.photo(camera.attribute("label").value());
    if (!photo) return;
    const auto sensor = chunk.child("sensors").find_child_by_attribute(
        "sensor", "id", camera.attribute("sensor_id").value());
    if (!sensor) model.fail(fmt::format("the sensor of '{}' is missing; export it again", *photo));
    const auto component = components.find(camera.attribute("component_id").value());
    const ToWorld& to = component == components.end() ? of_chunk : component->second;
    const auto m = numbers_of(model, transform, 16);
    model.add_at(*photo, camera_of_sensor(model, sensor),
                 product(to.R, {{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}}),
                 to.scale * multiply(to.R, Vec3d(m[3], m[7], m[11])) + to.t);
  });
  if (!of_rigs.empty())
    log_warning(
        "{} photos of {}, such as '{}', hang on another camera of a rig and have no pose of "
        "their own: left out; export the cameras for COLMAP, which writes all poses",
        of_rigs.size(), model.file().string(), of_rigs[0]);
}

}  // namespace gs
