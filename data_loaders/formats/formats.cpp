// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/formats/formats.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>

#include "data_loaders/formats/coding/compression.h"
#include "data_loaders/formats/coding/finite_rows.h"
#include "data_loaders/formats/csv.h"
#include "data_loaders/formats/glb.h"
#include "data_loaders/formats/ply/compressed_ply.h"
#include "data_loaders/formats/ply/ply.h"
#include "data_loaders/formats/sog/sog.h"
#include "data_loaders/formats/sog/webp.h"
#include "data_loaders/formats/splat.h"
#include "data_loaders/formats/spz/spz.h"
#include "gs_core/error.h"
#include "gs_core/io/byte_reader.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

const AxisSigns kPlyAxes{1, 1, 1};

// A writer without options, as the table wants it.
template <auto writer>
void write_plainly(const Path& path, const GaussianModel& model, const ExportOptions&) {
  writer(path, model);
}
void write_spz_version(const Path& path, const GaussianModel& model, const ExportOptions& options) {
  write_spz(path, model, options.spz_version);
}

void require_nothing(const ExportOptions&) {}
void require_for_spz(const ExportOptions& options) {
  options.spz_version == 4 ? require_zstd() : require_zlib();
}
void require_for_sog(const ExportOptions&) { require_webp(); }

}  // namespace

const std::vector<ModelFormat>& model_formats() {
  static const std::vector<ModelFormat> kFormats = {
      {"ply", ".ply", "everything, as floats", true, kPlyAxes, read_gaussian_ply,
       write_plainly<write_gaussian_ply>, require_nothing},
      {"csv", ".csv", "everything, as text", true, kPlyAxes, read_csv, write_plainly<write_csv>,
       require_nothing},
      {"glb", ".glb", "everything, as floats after activation", false, kHalfTurnZ, nullptr,
       write_plainly<write_glb>, require_nothing},
      {"compressed.ply", ".compressed.ply", "fractions of the range of 256 neighbors", false,
       kPlyAxes, read_gaussian_ply, write_plainly<write_compressed_ply>, require_nothing},
      {"spz", ".spz", "bytes, positions in 24 bits, compressed", false, kHalfTurnX, read_spz,
       write_spz_version, require_for_spz},
      {"sog", ".sog", "codebooks and a palette of SH, compressed", false, kPlyAxes, read_sog,
       write_plainly<write_sog>, require_for_sog},
      {"splat", ".splat", "bytes, no SH beyond degree 0", false, kPlyAxes, read_splat,
       write_plainly<write_splat>, require_nothing},
  };
  return kFormats;
}

std::string format_names() {
  std::string names;
  for (const ModelFormat& format : model_formats())
    names += (names.empty() ? "" : ", ") + std::string(format.name);
  return names;
}

const ModelFormat& format_named(std::string_view name) {
  for (const ModelFormat& format : model_formats())
    if (format.name == name || format.ending == name) return format;
  throw UsageError(fmt::format("there is no format {}; there are {}", name, format_names()));
}

const ModelFormat* find_format(const Path& path) {
  std::string name = path.filename().string();
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return char(std::tolower(c)); });
  const ModelFormat* longest = nullptr;
  for (const ModelFormat& format : model_formats())
    if (name.ends_with(format.ending) &&
        (!longest || format.ending.size() > longest->ending.size()))
      longest = &format;
  return longest;
}

const ModelFormat& format_to_write(const Path& path) {
  if (const ModelFormat* format = find_format(path)) return *format;
  throw UsageError(
      fmt::format("{} says no format by its ending; there are {}", path.string(), format_names()));
}

GaussianModel read_model(const Path& path) {
  const ModelFormat* format = find_format(path);
  if (!format) return read_gaussian_ply(path);
  if (!format->read)
    cannot_read(path, fmt::format("{} is written here and not read; name the model it was made of",
                                  format->ending));
  return format->read(path);
}

std::size_t write_model(const Path& path, const GaussianModel& model,
                        const ExportOptions& options) {
  const ModelFormat& format = format_to_write(path);
  if (format.name == "ply") return model.gaussians.count() - write_gaussian_ply(path, model);
  const GaussianModel finite = finite_model(model);
  format.write(path, finite, options);
  warn_of_left_out(path, finite.gaussians.count(), model.gaussians.count());
  return finite.gaussians.count();
}

}  // namespace gs
