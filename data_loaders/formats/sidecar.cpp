// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/formats/sidecar.h"

#include <cmath>
#include <new>
#include <nlohmann/json.hpp>
#include <vector>

#include "gs_core/access.h"
#include "gs_core/error.h"
#include "gs_core/io/atomic_file.h"
#include "gs_core/io/read_json.h"
#include "gs_core/log.h"
#include "gs_core/plain_message.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kSameAxis = 1e-9;  // entries of a matrix that differ by less are the same

Json rows_of(const Mat4d& matrix) {
  Json rows = Json::array();
  for (const auto& row : matrix.m) {
    Json numbers = Json::array();
    for (const double number : row) numbers.push_back(number + 0.0);  // no -0
    rows.push_back(numbers);
  }
  return rows;
}

// The PLY's axes are x right, y down, z forward, as seen by a camera that looks along z.
Json axes_of(const AxisSigns& signs) {
  return {{"x", signs.x > 0 ? "right" : "left"},
          {"y", signs.y > 0 ? "down" : "up"},
          {"z", signs.z > 0 ? "forward" : "backward"}};
}

Json json_of(const Georeference& georeference, const FileFrames& frames) {
  const Geodetic& origin = georeference.origin;
  const Mat4d enu_from_file =
      multiply(matrix_of(georeference.enu_from_input), frames.input_from_file());
  const Mat4d ecef_from_file = multiply(matrix_of(ecef_from_enu(origin)), enu_from_file);
  return {{"origin", {origin.longitude, origin.latitude, origin.height}},
          {"enu_from_file", rows_of(enu_from_file)},
          {"ecef_from_file", rows_of(ecef_from_file)}};
}

Json json_of(const ExportedFile& exported) {
  const FileFrames& frames = exported.frames;
  Json json = {{"file", exported.file.filename().string()},
               {"format", exported.format->name},
               {"gaussians", exported.gaussians},
               {"bytes", exported.bytes},
               {"bytes_per_gaussian", exported.bytes_per_gaussian()},
               {"sh_degree", exported.sh_degree},
               {"antialiased", exported.antialiased},
               {"axes", axes_of(exported.format->signs)},
               {"input_from_file", rows_of(frames.input_from_file())},
               {"file_from_input", rows_of(inverse_of(frames.input_from_file()))},
               {"input_from_train", rows_of(frames.input_from_train)},
               {"train_from_input", rows_of(inverse_of(frames.input_from_train))}};
  if (const auto& fidelity = exported.fidelity)
    json["fidelity"] = {
        {"psnr", fidelity->psnr}, {"ssim", fidelity->ssim}, {"num_views", fidelity->num_views}};
  if (exported.georeference) json["georeference"] = json_of(*exported.georeference, frames);
  return json;
}

/// Whether the upper left 3x3 of `rows` is the diagonal of these signs: no turn, no scale.
bool has_plain_axes(const std::vector<std::vector<double>>& rows, const AxisSigns& signs) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (std::abs(rows.at(i).at(j) - (i == j ? double(signs[i]) : 0)) > kSameAxis) return false;
  return true;
}

}  // namespace

FileFrames frames_of(const ModelFormat& format, const GaussianModel& model,
                     const ModelTransform& transform) {
  const bool adds_offset = format.adds_world_offset && transform.is_identity();
  const Mat4d file_from_placed =
      adds_offset ? multiply(diagonal(format.signs), translation(model.world_offset))
                  : diagonal(format.signs);
  return {multiply(file_from_placed, matrix_of(transform)), translation(model.world_offset)};
}

fs::path sidecar_of(const fs::path& file) { return file.string() + ".transforms.json"; }

void write_sidecar(const ExportedFile& exported) {
  AtomicFile file(sidecar_of(exported.file));
  file.write(json_of(exported).dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
  file.commit();
}

void take_sidecar(const fs::path& file, GaussianModel& model) {
  const fs::path sidecar = sidecar_of(file);
  const ModelFormat* const format = find_format(file);
  if (!format || !fs::exists(sidecar)) return;
  try {
    const Json json = read_json(sidecar);
    std::vector<std::vector<double>> rows;
    bool antialiased = false;
    take_from_json(sidecar, "export the model again", [&] {
      rows = json.at("input_from_file").get<std::vector<std::vector<double>>>();
      antialiased = json.at("antialiased").get<bool>();
    });
    if (!has_plain_axes(rows, format->signs)) return;
    const Vec3d offset{rows.at(0).at(3), rows.at(1).at(3), rows.at(2).at(3)};
    // A format that adds the offset was read without it already; `offset` is what is still missing.
    model.world_offset = format->adds_world_offset ? model.world_offset + offset : offset;
    model.antialiased = antialiased;
    model.is_ours = true;
  } catch (const AccessError&) {  // without it the model would stand elsewhere
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    log_warning("{} is ignored: {}", sidecar.string(), plain_message(error));
  }
}

}  // namespace gs
