// SPDX-License-Identifier: Apache-2.0
#include "gs_model/tiles/tileset.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/bake_filter.h"
#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/spz/spz.h"
#include "gs_model/tiles/tile_file.h"
#include "gs_model/tiles/tile_tree.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// The model in meters east, north and up, as tiles hold it.
GaussianModel placed(const GaussianModel& model, const TilesetRequest& request) {
  GaussianModel result = finite_model(model);
  warn_of_left_out(request.folder.string(), result.gaussians.count(), model.gaussians.count());
  bake_filter(result.gaussians);
  limit_sh_degree(result, request.sh_degree);
  transform_model(result, transform_of(request.georeference.enu_from_input, model.world_offset));
  return result;
}

/// Tiles are .spz inside, which ends somewhere. Real scenes have Gaussians far away or huge ones
/// now and then, as part of their sky.
void check_reach(const GaussianModel& placed, const fs::path& folder) {
  std::size_t far = 0, large = 0;
  double farthest = 0;
  for (std::size_t i = 0; i < placed.gaussians.count(); ++i) {
    const Vec3f& at = placed.gaussians.mean[i];
    const double reach = std::max({std::abs(at.x), std::abs(at.y), std::abs(at.z)});
    const Vec3f& s = placed.gaussians.log_scale[i];
    far += reach > kSpzFineReach;
    large += std::exp(double(std::max({s.x, s.y, s.z}))) > kSpzLargestSigma;
    farthest = std::max(farthest, reach);
  }
  if (!(farthest <= kSpzReach))
    throw Error(
        fmt::format("cannot write {}: a Gaussian stands {:.3g} m from the georeference's origin; "
                    "find the place "
                    "again with `gemsplat georef`, for the scene that the model was trained on",
                    folder.string(), farthest));
  if (far > 0)
    log_warning(
        "{}: {} Gaussians stand up to {:.0f} m from the georeference's origin; tiles with such "
        "beyond {} m have their positions in coarser steps than 1/4096 m",
        folder.string(), far, farthest, kSpzFineReach);
  if (large > 0)
    log_warning("{}: {} Gaussians are wider than {} m and were cut down to that size",
                folder.string(), large, kSpzLargestSigma);
}

/// Center and half axes, as 3D Tiles has a box.
Json json_of(const TileBox& box) {
  const Vec3d center = 0.5 * (box.low + box.high), half = 0.5 * (box.high - box.low);
  return {{"box", {center.x, center.y, center.z, half.x, 0, 0, 0, half.y, 0, 0, 0, half.z}}};
}

/// Writes the tiles of a tree and describes them.
class TileWriter {
 public:
  TileWriter(const TilesetRequest& request, const GaussianModel& placed)
      : folder_(request.folder), placed_(placed) {
    written_.folder = request.folder;
  }

  Json write(Tile& tile, std::size_t level = 0) {
    if (counts_.size() == level) counts_.push_back(0);
    const std::string name = fmt::format("{}/{}.glb", level, counts_[level]++);
    if (tile.children.empty()) written_.gaussians += tile.gaussians.count();
    const GaussianModel model{std::move(tile.gaussians), placed_.sh_degree, placed_.is_ours,
                              placed_.antialiased};
    written_.bytes += write_tile(folder_ / name, model);
    ++written_.tiles;
    Json json = {{"boundingVolume", json_of(tile.box)},
                 {"geometricError", tile.geometric_error},
                 {"refine", "REPLACE"},
                 {"content", {{"uri", name}}}};
    for (Tile& child : tile.children) json["children"].push_back(write(child, level + 1));
    return json;
  }
  ExportedTileset written() const {
    ExportedTileset result = written_;
    result.levels = counts_.size();
    return result;
  }

 private:
  fs::path folder_;
  const GaussianModel& placed_;
  std::vector<std::size_t> counts_;  // of the levels
  ExportedTileset written_;
};

/// From the tiles to earth-centered coordinates, by columns.
Json transform_to_earth(const Geodetic& origin) {
  const Mat4d matrix = matrix_of(ecef_from_enu(origin));
  Json columns = Json::array();
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 4; ++row) columns.push_back(matrix.m[row][column]);
  return columns;
}

/// A viewer shows nothing of a tileset whose own error is small on screen. This one is as large as
/// what it shows.
double error_of_nothing(const Tile& root) {
  return std::max(length(root.box.high - root.box.low), root.geometric_error);
}

Json tileset_of(const Geodetic& origin, double error, Json root) {
  const Json tiles = Json::array({kTileGaussians, kTileSpz});
  const Json content_gltf = Json::array({"3DTILES_content_gltf"});
  Json placed_root = {{"transform", transform_to_earth(origin)}};
  placed_root.update(root);
  return {{"asset", {{"version", "1.1"}, {"generator", fmt::format("gemsplat {}", kVersion)}}},
          {"extensionsUsed", content_gltf},
          {"extensionsRequired", content_gltf},
          {"extensions",
           {{"3DTILES_content_gltf", {{"extensionsUsed", tiles}, {"extensionsRequired", tiles}}}}},
          {"geometricError", error},
          {"root", placed_root}};
}

}  // namespace

void check_tileset(const TilesetRequest& request, bool force) {
  require_zlib();
  const fs::path& folder = request.folder;
  if (!fs::exists(folder)) return;
  if (!fs::is_directory(folder))
    throw UsageError(folder.string() +
                     " is a file, and a tileset is a folder; choose another name");
  if (is_empty_output(folder)) return;
  if (!force)
    throw UsageError(
        fmt::format("the folder {} is not empty; choose another name, or add --force to keep it as "
                    "{}.bak-N",
                    folder.string(), folder.filename().string()));
  check_may_move(folder, request.needed);
}

ExportedTileset export_tileset(const GaussianModel& model, const TilesetRequest& request) {
  if (model.gaussians.has_time)
    throw UsageError(
        "3D Tiles do not hold Gaussians in space and time; write the moment T with `gemsplat "
        "export --time T`");
  GaussianModel placed_model = placed(model, request);
  if (placed_model.gaussians.count() == 0)
    throw Error(
        fmt::format("cannot write {}: there are no Gaussians; train again, or name another "
                    "model",
                    request.folder.string()));
  check_reach(placed_model, request.folder);
  const OutputLock lock = OutputLock::of_freed_folder(request.folder, request.needed);
  Tile root = tile_tree(placed_model.gaussians, request.most_gaussians);
  placed_model.gaussians = Gaussians();
  const double error = error_of_nothing(root);
  TileWriter writer(request, placed_model);
  const Json json = tileset_of(request.georeference.origin, error, writer.write(root));
  AtomicFile file(request.folder / "tileset.json");
  file.write(file_text(json));
  file.commit();
  return writer.written();
}

std::string summary(const ExportedTileset& tileset, const Georeference& georeference) {
  return fmt::format(
      "{}: {} Gaussians in {} tiles of {} levels, {:.1f} MB, at longitude {:.7f}, latitude {:.7f}",
      tileset.folder.string(), tileset.gaussians, tileset.tiles, tileset.levels,
      double(tileset.bytes) / 1e6, georeference.origin.longitude, georeference.origin.latitude);
}

}  // namespace gs
