// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/georef/georef_file.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <vector>

#include "gs_core/geometry/vectors.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

using Rows = std::vector<std::vector<double>>;

constexpr int kVersion1 = 1;
constexpr double kTurnTolerance = 1e-6;  // of inner products: rows are written with all digits
constexpr double kMostMeters = 1e9;      // of a unit, and of a scene's zero from the origin
constexpr const char* kRemedyOfGeoref = "write it again with `gemsplat georef`";

Json rows_of(const Similarity& similarity) {
  Json rows = Json::array();
  int axis = 0;
  for (const Vec3d& row : {similarity.R.row0, similarity.R.row1, similarity.R.row2}) {
    const Vec3d scaled = similarity.scale * row;
    rows.push_back({scaled.x, scaled.y, scaled.z, similarity.shift[axis++]});
  }
  rows.push_back({0, 0, 0, 1});
  return rows;
}

Vec3d row_of(const Rows& rows, int i) { return {rows[i][0], rows[i][1], rows[i][2]}; }

bool is_4x4(const Rows& rows) {
  if (rows.size() != 4) return false;
  for (const auto& row : rows)
    if (row.size() != 4) return false;
  return rows[3] == std::vector<double>{0, 0, 0, 1};
}

Similarity similarity_of(const std::filesystem::path& path, const Rows& rows) {
  Similarity result;
  if (is_4x4(rows)) {
    result.scale = length(row_of(rows, 0));
    result.R = {row_of(rows, 0) / result.scale, row_of(rows, 1) / result.scale,
                row_of(rows, 2) / result.scale};
    result.shift = {rows[0][3], rows[1][3], rows[2][3]};
  }
  const bool is_sound = is_4x4(rows) && result.scale > 0 && result.scale <= kMostMeters &&
                        is_rotation(result.R, kTurnTolerance) &&
                        length(result.shift) <= kMostMeters;
  if (!is_sound)
    cannot_read(path, fmt::format("enu_from_input does not turn, scale evenly and shift; {}",
                                  kRemedyOfGeoref));
  return result;
}

Geodetic place_of(const std::filesystem::path& path, const std::vector<double>& numbers) {
  const Geodetic place =
      numbers.size() == 3 ? Geodetic{numbers[0], numbers[1], numbers[2]} : Geodetic{NAN, NAN, NAN};
  if (!is_on_earth(place))
    cannot_read(path, fmt::format("its origin is not the longitude, latitude and height of a place "
                                  "on earth; {}",
                                  kRemedyOfGeoref));
  return place;
}

}  // namespace

std::filesystem::path georef_file_of(const std::filesystem::path& scene) {
  return scene / "georef.json";
}

void write_georef(const std::filesystem::path& path, const GeorefFile& file) {
  const Geodetic& origin = file.georeference.origin;
  Json json = {{"version", kVersion1},
               {"source", file.source},
               {"heights", file.heights},
               {"origin", {origin.longitude, origin.latitude, origin.height}},
               {"enu_from_input", rows_of(file.georeference.enu_from_input)}};
  if (const auto& quality = file.quality) {
    json["cameras"] = quality->cameras;
    json["cameras_that_fit"] = quality->fitting;
    json["rms_m"] = quality->rms;
  }
  AtomicFile written(path);
  written.write(file_text(json));
  written.commit();
}

Georeference read_georef(const std::filesystem::path& path) {
  const Json json = read_json_as<Json>(path, kRemedyOfGeoref);
  double version = 0;
  std::vector<double> origin;
  Rows rows;
  take_from_json(path, kRemedyOfGeoref, [&] {
    version = json.at("version").get<double>();
    if (version != kVersion1) return;
    origin = json.at("origin").get<std::vector<double>>();
    rows = json.at("enu_from_input").get<Rows>();
  });
  if (version != kVersion1)
    cannot_read(path, fmt::format("it has version {}, and this gemsplat reads version {}; {}",
                                  version, kVersion1, kRemedyOfGeoref));
  return {place_of(path, origin), similarity_of(path, rows)};
}

}  // namespace gs
