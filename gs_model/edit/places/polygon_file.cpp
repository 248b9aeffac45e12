// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/places/polygon_file.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <string>
#include <vector>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/parse_number.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

using Path = std::filesystem::path;
using Ring = std::vector<Vec2<double>>;

constexpr std::uint64_t kMostBytes = std::uint64_t(16) << 20;
constexpr const char* kBlanks = " \t\r,";
constexpr const char* kRemedyOfPolygons =
    "draw the area again: polygons of GeoJSON, or a vertex a line as two numbers";

Vec2<double> vertex_of(const Path& file, std::string_view line, int number) {
  double xy[2];
  int count = 0;
  for (std::size_t at = 0; (at = line.find_first_not_of(kBlanks, at)) != line.npos; ++count) {
    const std::size_t end = std::min(line.find_first_of(kBlanks, at), line.size());
    double value;
    if (!parse_number(line.substr(at, end - at), value) || !std::isfinite(value) || count == 2)
      cannot_read(file, fmt::format("line {} is no vertex: \"{}\"; a vertex is two numbers, as in "
                                    "\"1.5, -2\"",
                                    number, line));
    xy[count] = value;
    at = end;
  }
  if (count != 2) cannot_read(file, fmt::format("line {} has one number; a vertex is two", number));
  return {xy[0], xy[1]};
}

std::vector<Ring> rings_of_text(const Path& file, std::string_view text) {
  std::vector<Ring> rings(1);
  int number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    ++number;
    const std::size_t first = line.find_first_not_of(kBlanks);
    if (first == line.npos && !rings.back().empty()) rings.emplace_back();
    if (first == line.npos || line[first] == '#') continue;
    rings.back().push_back(vertex_of(file, line, number));
  }
  if (rings.back().empty()) rings.pop_back();
  return rings;
}

// A GeoJSON object: a feature, a collection, or a geometry.
void add_rings(const SortedJson& object, std::vector<Ring>& rings) {
  const auto add_polygon = [&](const SortedJson& polygon) {
    for (const SortedJson& ring : polygon) {
      Ring vertices;
      for (const SortedJson& vertex : ring)
        vertices.push_back({vertex.at(0).get<double>(), vertex.at(1).get<double>()});
      rings.push_back(std::move(vertices));
    }
  };
  const auto type = object.at("type").get<std::string>();
  if (type == "FeatureCollection")
    for (const SortedJson& feature : object.at("features")) add_rings(feature, rings);
  else if (type == "GeometryCollection")
    for (const SortedJson& geometry : object.at("geometries")) add_rings(geometry, rings);
  else if (type == "Feature")
    add_rings(object.at("geometry"), rings);
  else if (type == "Polygon")
    add_polygon(object.at("coordinates"));
  else if (type == "MultiPolygon")
    for (const SortedJson& polygon : object.at("coordinates")) add_polygon(polygon);
}

std::vector<Ring> rings_of_json(const Path& file, std::string_view text) {
  const SortedJson json = parse_json<SortedJson>(file, text, kRemedyOfPolygons);
  std::vector<Ring> rings;
  take_from_json(file, kRemedyOfPolygons, [&] { add_rings(json, rings); });
  return rings;
}

}  // namespace

Polygon read_polygon(const Path& file) {
  const std::string text = read_text_file(file, kMostBytes);
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  std::vector<Ring> rings = first != text.npos && text[first] == '{' ? rings_of_json(file, text)
                                                                     : rings_of_text(file, text);
  if (rings.empty()) cannot_read(file, std::string("it holds no polygon; ") + kRemedyOfPolygons);
  for (const Ring& ring : rings)
    if (ring.size() < 3)
      cannot_read(file, fmt::format("a ring has {} vertices, and an area needs 3; {}", ring.size(),
                                    kRemedyOfPolygons));
  return Polygon(std::move(rings));
}

}  // namespace gs
