// SPDX-License-Identifier: Apache-2.0
// The formats of trained Gaussians, in one table: what a file's name says, who reads it and who writes it. A new format is
// one row there.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "data_loaders/formats/coding/frame.h"
#include "gs_core/gaussians.h"

namespace gs {

/// What a user may choose of how a file is written.
struct ExportOptions {
  int spz_version = 3;  // or 4, which fewer viewers read
};

struct ModelFormat {
  std::string_view name;    // as in --export: "spz"
  std::string_view ending;  // of the files' names: ".spz"
  std::string_view holds;   // in a few words
  bool is_lossless;         // what is read back has the same bits, SH degree included
  AxisSigns signs;          // of the file's axes in terms of the PLY's
  GaussianModel (*read)(const std::filesystem::path&);  // null: is written only
  void (*write)(const std::filesystem::path&, const GaussianModel&, const ExportOptions&);
  void (*require)(const ExportOptions&);  // throws Error where this build lacks a library for it
};

/// All of them, in the order of a list for people.
const std::vector<ModelFormat>& model_formats();

/// The names of all that can be written: "ply, compressed.ply, ..."
std::string format_names();

/// The format of a name such as "spz"; throws UsageError that lists them where there is none.
const ModelFormat& format_named(std::string_view name);
/// That which a file's name ends in, in whatever case; null where it is none.
const ModelFormat* find_format(const std::filesystem::path& path);
/// The same to write to; throws UsageError that lists the endings where there is none.
const ModelFormat& format_to_write(const std::filesystem::path& path);

/// Reads trained Gaussians of the format that the name says, or else as PLY. Throws Error as the readers do, and for formats that
/// are only written.
GaussianModel read_model(const std::filesystem::path& path);

/// Writes a model in the format that the name says, whole or not at all. Rows with NaN or infinity are left out, with a
/// warning; returns how many rows were written. Throws Error as the writers do.
std::size_t write_model(const std::filesystem::path& path, const GaussianModel& model,
                        const ExportOptions& options = {});

}  // namespace gs
