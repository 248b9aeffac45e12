// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/formats.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>

#include "gs_core/bake_filter.h"
#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/ascii.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/foreign_files.h"
#include "gs_model/formats/glb/glb.h"
#include "gs_model/formats/gs4d/gs4d.h"
#include "gs_model/formats/lod/rad.h"
#include "gs_model/formats/npz/vectree.h"
#include "gs_model/formats/ply/compressed_ply.h"
#include "gs_model/formats/ply/ply.h"
#include "gs_model/formats/sog/sog.h"
#include "gs_model/formats/sog/webp.h"
#include "gs_model/formats/splat.h"
#include "gs_model/formats/spz/spz.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Path = fs::path;

constexpr std::string_view kOtherOutputs =
    "`gemsplat export` also makes a page (.html) and a tileset (a name that ends in /)";

const AxisSigns kPlyAxes{1, 1, 1};

// Gives a writer that has no options the signature of the table.
template <auto writer>
void without_options(ByteSink& sink, const GaussianModel& model, const ExportOptions&) {
  writer(sink, model);
}
void write_spz_version(ByteSink& sink, const GaussianModel& model, const ExportOptions& options) {
  write_spz(sink, model, {options.spz_version, options.spz_sh_bits});
}
void write_gs4d_with(ByteSink& sink, const GaussianModel& model, const ExportOptions& options) {
  write_gs4d(sink, model, options.duration);
}
// Gives a writer of codebooks the signature of the table.
template <auto writer>
void with_importance(ByteSink& sink, const GaussianModel& model, const ExportOptions& options) {
  // Rows that are not finite were left out, and nothing was measured of such a model.
  const bool is_measured = options.importance.color.size() == model.gaussians.count();
  writer(sink, model, is_measured ? options.importance : RowImportance{});
}
// Gives a writer of stages the signature of the table.
template <auto writer>
void with_views(ByteSink& sink, const GaussianModel& model, const ExportOptions& options) {
  writer(sink, model, options.views);
}
void write_whole_ply(ByteSink& sink, const GaussianModel& model, const ExportOptions&) {
  write_gaussian_ply(sink, model);
}

void require_nothing(const ExportOptions&) {}
void require_for_spz(const ExportOptions& options) {
  options.spz_version == 4 ? require_zstd() : require_zlib();
}
void require_for_zlib(const ExportOptions&) { require_zlib(); }
void require_for_sog(const ExportOptions&) { require_webp(); }

// A folder of files that gemsplat only reads. Its ending is the whole name of the file that stands
// for the folder.
const ModelFormat kSogFolder = {"sog folder",    "meta.json", "SOG, unpacked",
                                false,           kPlyAxes,    Holds::still,
                                read_sog_folder, nullptr,     require_for_sog};
constexpr std::string_view kVectree = "extreme_saving.zip";
constexpr std::string_view kLodMeta = "lod-meta.json";  // of a streamed SOG

// What takes the place of formats that gemsplat wrote once.
std::string_view instead_of(std::string_view name) {
  if (name.ends_with("csv")) return "numpy.savetxt makes a table of the arrays of gemsplat.load()";
  if (name == kLodMeta)
    return "a .rad has levels of detail, too, and splat-transform makes a streamed SOG of .ply "
           "files";
  return kOtherOutputs;
}

}  // namespace

const std::vector<ModelFormat>& model_formats() {
  constexpr bool kLossless = true, kLossy = false;
  static const std::vector<ModelFormat> kFormats = {
      {"ply", ".ply", "everything, as floats", kLossless, kPlyAxes, Holds::both, read_gaussian_ply,
       write_whole_ply, require_nothing, true},
      {"glb", ".glb", "everything, as floats after activation", kLossy, kHalfTurnZ, Holds::still,
       read_glb, without_options<write_glb>, require_nothing},
      {"compressed.ply", ".compressed.ply", "fractions of the range of 256 neighbors", kLossy,
       kPlyAxes, Holds::still, read_gaussian_ply, without_options<write_compressed_ply>,
       require_nothing, true},
      {"spz", ".spz", "bytes, positions in 24 bits, compressed", kLossy, kHalfTurnX, Holds::still,
       read_spz, write_spz_version, require_for_spz, true},
      {"sog", ".sog", "codebooks and a palette of SH, compressed", kLossy, kPlyAxes, Holds::still,
       read_sog, without_options<write_sog>, require_for_sog},
      {"rad", ".rad", "a tree of levels of detail, floats of 16 bits, compressed", kLossy, kPlyAxes,
       Holds::still, read_rad, without_options<write_rad>, require_for_zlib},
      {"npz", ".npz", "codebooks of colors and shapes, bytes, compressed", kLossy, kPlyAxes,
       Holds::still, read_npz, with_importance<write_npz>, require_for_zlib, false, true},
      {"vectree", ".extreme_saving.zip",
       "floats of 16 bits, a codebook of colors for most, compressed", kLossy, kPlyAxes,
       Holds::still, read_vectree, with_importance<write_vectree>, require_for_zlib, false, true},
      {"splat", ".splat", "bytes, no SH beyond degree 0", kLossy, kPlyAxes, Holds::still,
       read_splat, without_options<write_splat>, require_nothing},
      {"usda", ".usda", "everything, as text after activation", kLossy, kHalfTurnZ, Holds::still,
       read_usd, with_views<write_usda>, require_nothing, false, false, true},
      {"usdc", ".usdc", "the same as bytes", kLossy, kHalfTurnZ, Holds::still, read_usd,
       with_views<write_usdc>, require_nothing, false, false, true},
      {"usdz", ".usdz", "a .usdc in a package", kLossy, kHalfTurnZ, Holds::still, read_usd,
       with_views<write_usdz>, require_nothing, false, false, true},
      {"gs4d", ".gs4d", "motion in chunks in the order of time, for the web", kLossy, kPlyAxes,
       Holds::moving, read_gs4d, write_gs4d_with, require_nothing, true},
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
  throw UsageError(fmt::format("gemsplat knows no format {}; it has {}; {}", name, format_names(),
                               instead_of(name)));
}

const ModelFormat* find_format(const Path& path) {
  const std::string name = lowercase(path.filename().string());
  if (name == kSogFolder.ending) return &kSogFolder;
  if (name == kVectree) return &format_named("vectree");     // as LightGaussian calls it
  if (name.ends_with(".usd")) return &format_named("usdc");  // a name for both kinds of layer
  const ModelFormat* longest = nullptr;
  for (const ModelFormat& format : model_formats())
    if (name.ends_with(format.ending) &&
        (!longest || format.ending.size() > longest->ending.size()))
      longest = &format;
  return longest;
}

const ModelFormat& format_to_write(const Path& path) {
  const ModelFormat* const found = find_format(path);
  if (found && found->write) return *found;
  if (found)
    throw UsageError(fmt::format("{}: gemsplat writes no {}; choose .sog, which is one file",
                                 path.string(), found->name));
  std::string endings;
  for (const ModelFormat& format : model_formats())
    endings += (endings.empty() ? "" : ", ") + std::string(format.ending);
  const std::string ending = path.extension().string();
  throw UsageError(fmt::format("{}: gemsplat does not write {}; it writes {}; {}", path.string(),
                               ending.empty() ? "files without an ending" : ending, endings,
                               instead_of(path.filename().string())));
}

Path model_in_folder(const Path& folder) {
  std::error_code ignored;
  for (const std::string_view name : {kSogFolder.ending, kLodMeta})
    if (fs::is_regular_file(folder / name, ignored)) return folder / name;
  return {};
}

GaussianModel read_model(const Path& named) {
  const Path inside = model_in_folder(named);
  const Path& path = inside.empty() ? named : inside;
  const ModelFormat* format = find_format(path);
  if (format && !format->read)
    cannot_read(
        path,
        fmt::format("gemsplat writes {} but does not read it; name the model that it was made from",
                    format->ending));
  if (format && format->read != read_gaussian_ply) return format->read(path);
  if (const std::string kind = foreign_kind(path); !kind.empty()) cannot_read(path, kind);
  return read_gaussian_ply(path);
}

bool holds(const ModelFormat& format, bool has_time) {
  return format.gaussians == Holds::both || (format.gaussians == Holds::moving) == has_time;
}

void check_holds(const ModelFormat& format, bool has_time, std::string_view file) {
  if (holds(format, has_time)) return;
  if (!has_time)
    throw UsageError(
        fmt::format("{}: {} holds Gaussians in space and time, and these are 3D Gaussians; choose "
                    ".spz or .sog for the web, or .ply",
                    file, format.ending));
  std::string others;
  for (const ModelFormat& other : model_formats())
    if (holds(other, true)) others += (others.empty() ? "" : " and ") + std::string(other.ending);
  throw UsageError(
      fmt::format("{}: {} does not hold Gaussians in space and time, but {} do; write the moment T "
                  "as 3D Gaussians with `gemsplat export --time T`",
                  file, format.ending, others));
}

std::size_t write_model(ByteSink& sink, const ModelFormat& format, const GaussianModel& model,
                        const ExportOptions& options) {
  check_holds(format, model.gaussians.has_time, sink.name());
  if (format.name == "ply") return model.gaussians.count() - write_gaussian_ply(sink, model);
  GaussianModel finite = finite_model(model);
  if (finite.gaussians.count() == 0 && !format.may_be_empty)
    throw Error(fmt::format(
        "cannot write {}: there are no Gaussians, and {} cannot hold an empty model; choose .ply",
        sink.name(), format.ending));
  bake_filter(finite.gaussians);
  format.write(sink, finite, options);
  warn_of_left_out(sink.name(), finite.gaussians.count(), model.gaussians.count());
  return finite.gaussians.count();
}

std::size_t write_model(const Path& path, const GaussianModel& model,
                        const ExportOptions& options) {
  const ModelFormat& format = format_to_write(path);
  check_holds(format, model.gaussians.has_time, path.string());
  AtomicFile file(path);
  const std::size_t rows = write_model(file, format, model, options);
  file.commit();
  return rows;
}

}  // namespace gs
