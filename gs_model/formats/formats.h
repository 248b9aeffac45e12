// SPDX-License-Identifier: Apache-2.0
// The table of formats of trained Gaussians: how a file's name ends, who reads it, who writes it.
//
// To add a format:
//   1. Write read_x(), write_x() or both in x.h and x.cpp beside this file; the header says what
//      each byte means. splat.h is the shortest example.
//   2. Add a row to the table in formats.cpp, and x.cpp to gs_model/CMakeLists.txt.
//   3. For a reader, add a row to kKinds in tests/model/formats_test.cpp (what may
//      be lost), and a target to tests/fuzz (damaged files).
//   4. Add a row to the tables of docs/reference/formats.md.
// Every verb that reads or writes a model then knows it: export, train --export, eval, render,
// info.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/npz/npz.h"
#include "gs_model/formats/usd/usd.h"

namespace gs {

/// Choices that a user has for some formats.
struct ExportOptions {
  int spz_version = 3;            // 2 for older readers, 4 that fewer read
  int spz_sh_bits = 0;            // SpzOptions::sh_bits
  double duration = 0;            // of a scene that moves, in seconds, for .gs4d; 0: not known
  RowImportance importance = {};  // of the Gaussians, in their order, for .npz; empty: not measured
  std::vector<NamedView> views = {};  // for .usda and .usdz; in the frame of the model
};

/// Which Gaussians a format can hold: 3D ones, ones in space and time, or either.
enum class Holds { still, moving, both };

struct ModelFormat {
  std::string_view name;    // as in --export: "spz"
  std::string_view ending;  // of file names: ".spz"
  std::string_view holds;   // in a few words
  bool is_lossless;         // reading gives the same bits again, SH degree included
  AxisSigns signs;          // of the file's axes relative to the PLY's
  Holds gaussians;          // with time, without, or both
  GaussianModel (*read)(const std::filesystem::path&);  // null: gemsplat only writes it
  // null: gemsplat only reads it
  void (*write)(ByteSink&, const GaussianModel&, const ExportOptions&);
  void (*require)(const ExportOptions&);  // throws Error where this build lacks a library for it
  bool may_be_empty = false;      // whether a file without Gaussians can be told from damage
  bool takes_importance = false;  // ExportOptions::importance
  bool takes_views = false;       // ExportOptions::views
};

/// All formats that gemsplat writes, in the order in which people see them.
const std::vector<ModelFormat>& model_formats();

/// The names of all formats: "ply, glb, ..."
std::string format_names();

/// The format of a name such as "spz". Throws UsageError with a list for an unknown name.
const ModelFormat& format_named(std::string_view name);
/// The format that a file name's ending stands for, in upper or lower case; null if there is none.
/// It may be one that is only read, and that model_formats() lacks: meta.json, which stands for a
/// folder of SOG files.
const ModelFormat* find_format(const std::filesystem::path& path);
/// The same for a file to write. Throws UsageError with a list of the endings.
const ModelFormat& format_to_write(const std::filesystem::path& path);

/// Whether files of the format can hold a model with time (`has_time`) or without.
bool holds(const ModelFormat& format, bool has_time);
/// Throws UsageError where they cannot. The message begins with `file` and names formats that can.
void check_holds(const ModelFormat& format, bool has_time, std::string_view file);

/// The file that a folder of SOG files is read by, meta.json (or lod-meta.json, which read_model()
/// refuses with a remedy); empty for others.
std::filesystem::path model_in_folder(const std::filesystem::path& folder);

/// Reads trained Gaussians in the format of the file's name, or of the file in a folder that
/// model_in_folder() finds; a file of another name is read as PLY.
/// Throws Error as the readers do, and one that names the kind of file for formats that are not
/// read (foreign_files.h).
GaussianModel read_model(const std::filesystem::path& path);

/// Writes a model in a format. A 3D filter is a column of a PLY; other formats have it in scales and
/// opacities. Rows with NaN or infinity are left out, with a warning. Returns how many rows were
/// written. Throws Error as the writers do.
std::size_t write_model(ByteSink& sink, const ModelFormat& format, const GaussianModel& model,
                        const ExportOptions& options = {});
/// The same as a file, whole or not at all, in the format of its name.
std::size_t write_model(const std::filesystem::path& path, const GaussianModel& model,
                        const ExportOptions& options = {});

}  // namespace gs
