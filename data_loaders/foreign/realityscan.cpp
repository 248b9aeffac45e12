// SPDX-License-Identifier: Apache-2.0
// The CSV of RealityScan, which was RealityCapture: a line for each photo, columns by the header's
// names. Lengths in a picture are those of a film of 36 mm for its longer side.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <sstream>

#include "data_loaders/foreign/foreign_model.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/text/ascii.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

constexpr std::uint64_t kMostCsv = 1 << 28;  // bytes
constexpr double kFilm = 36;                 // mm

std::vector<std::string> fields_of(const std::string& line) {
  std::vector<std::string> fields;
  std::istringstream parts(line);
  for (std::string part; std::getline(parts, part, ',');)
    fields.emplace_back(trimmed(part, " \t\r\""));
  return fields;
}

/// Rz(-heading) Rx(pitch) Ry(roll), degrees: the axes of a camera that looks along -z with y up.
Mat3<double> axes_of(double heading, double pitch, double roll) {
  constexpr double kDegree = std::numbers::pi / 180;
  const double ch = std::cos(-heading * kDegree), sh = std::sin(-heading * kDegree);
  const double cp = std::cos(pitch * kDegree), sp = std::sin(pitch * kDegree);
  const double cr = std::cos(roll * kDegree), sr = std::sin(roll * kDegree);
  return {{ch * cr - sh * sp * sr, -sh * cp, ch * sr + sh * sp * cr},
          {sh * cr + ch * sp * sr, ch * cp, sh * sr - ch * sp * cr},
          {-cp * sr, sp, cp * cr}};
}

}  // namespace

void read_realityscan(ForeignModel& model) {
  std::istringstream lines(read_text_file(model.file(), kMostCsv));
  std::string line;
  std::getline(lines, line);
  if (line.starts_with("\xef\xbb\xbf")) line.erase(0, 3);
  std::map<std::string, std::size_t> columns;
  for (std::string name : fields_of(line)) {
    if (name.starts_with('#')) name.erase(0, 1);
    columns.try_emplace(lowercase(name), columns.size());
  }
  for (const char* name : {"name", "x", "y", "alt", "heading", "pitch", "roll", "f"})
    if (!columns.contains(name))
      model.fail(
          fmt::format("its header has no column '{}'; export Internal/External camera "
                      "parameters, with all of them",
                      name));
  for (int number = 2; std::getline(lines, line); ++number) {
    const std::vector<std::string> fields = fields_of(line);
    if (fields.empty() || fields[0].empty()) continue;
    const auto value = [&](const char* name) {
      const auto column = columns.find(name);
      double result = 0;
      if (column == columns.end()) return result;
      if (column->second >= fields.size() || !parse_number(fields[column->second], result))
        model.fail(fmt::format("line {} has no number for '{}'; export it again", number, name));
      return result;
    };
    if (columns["name"] >= fields.size()) model.fail(fmt::format("line {} has no name", number));
    const auto photo = model.photo(fields[columns["name"]]);
    if (!photo) continue;
    const PhotoSize size = model.size_of(*photo);
    const double longer = std::max(size.width, size.height);
    const double f = value("f") * longer / kFilm;
    const std::uint32_t camera =
        model.camera(size, {f, f, value("px") * longer + 0.5 * size.width,
                            value("py") * longer + 0.5 * size.height, value("k1"), value("k2"),
                            value("k3"), value("k4"), value("t1"), value("t2")});
    model.add_at(*photo, camera, axes_of(value("heading"), value("pitch"), value("roll")),
                 {value("x"), value("y"), value("alt")}, true);
  }
}

}  // namespace gs
