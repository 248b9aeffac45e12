// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/sidecar.h"

#include <cmath>
#include <new>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/plain_message.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

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
  if (exported.was_moved) json["was_moved"] = true;
  if (const auto& fidelity = exported.fidelity)
    json["fidelity"] = {
        {"psnr", fidelity->psnr}, {"ssim", fidelity->ssim}, {"num_views", fidelity->num_views}};
  if (exported.georeference) json["georeference"] = json_of(*exported.georeference, frames);
  return json;
}

/// What a sidecar says of its file.
struct Sidecar {
  Mat4d input_from_file{};
  bool antialiased = false, was_moved = false;
};

Sidecar read_sidecar(const fs::path& path) {
  const Json json = read_json(path);
  Sidecar sidecar;
  take_from_json(path, "export the model again", [&] {
    const Json& rows = json.at("input_from_file");
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = 0; j < 4; ++j)
        sidecar.input_from_file.m[i][j] = rows.at(i).at(j).get<double>();
    sidecar.antialiased = json.at("antialiased").get<bool>();
    sidecar.was_moved = json.value("was_moved", false);
  });
  if (!is_similarity(sidecar.input_from_file))
    throw Error("input_from_file does not turn, scale evenly and move; export the model again");
  return sidecar;
}

/// Whether the matrix has these signs on its diagonal and moves, but neither turns nor scales.
bool has_plain_axes(const Mat4d& matrix, const AxisSigns& signs) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (std::abs(matrix.m[i][j] - (i == j ? double(signs[i]) : 0)) > kSameAxis) return false;
  return true;
}

}  // namespace

FileFrames frames_of(const ModelFormat& format, const GaussianModel& model,
                     const ModelTransform& transform) {
  return {multiply(diagonal(format.signs), matrix_of(transform)), translation(model.world_offset)};
}

fs::path sidecar_of(const fs::path& file) { return file.string() + ".transforms.json"; }

void write_sidecar(const ExportedFile& exported) {
  AtomicFile file(sidecar_of(exported.file));
  file.write(file_text(json_of(exported)));
  file.commit();
}

std::optional<Mat4d> take_sidecar(const fs::path& file, GaussianModel& model) {
  const fs::path path = sidecar_of(file);
  const ModelFormat* const format = find_format(file);
  if (!format || !fs::exists(path)) return {};
  try {
    const Sidecar sidecar = read_sidecar(path);
    const Mat4d& matrix = sidecar.input_from_file;
    model.antialiased = sidecar.antialiased;
    model.is_ours = true;
    if (sidecar.was_moved || !has_plain_axes(matrix, format->signs))
      return multiply(matrix, diagonal(format->signs));
    model.world_offset = {matrix.m[0][3], matrix.m[1][3], matrix.m[2][3]};
  } catch (const AccessError&) {  // without it the model would stand elsewhere
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    log_warning("{} is ignored: {}", path.string(), plain_message(error));
  }
  return {};
}

}  // namespace gs
