// SPDX-License-Identifier: Apache-2.0
// Levels of detail of a model as files for viewers that stream: gemsplat export --lod. The folder
// holds lod-meta.json with the folders of streamed SOG, model.rad with the same levels, and
// levels.md, the table of what each level costs. Both models have a sidecar.
#pragma once

#include <optional>

#include "gs_app/export/export_model.h"
#include "gs_model/formats/lod/streamed_sog.h"

namespace gs {

struct LevelsRequest {
  std::filesystem::path folder;
  ModelTransform transform = {};
  int sh_degree = kMaxShDegree;  // the files have no higher one
  LodOptions lod = {};
  std::vector<std::filesystem::path> needed = {};  // may not be moved aside with the folder
};

/// A level as it is read back from the folder.
struct ExportedLevel {
  StreamedLevel written;
  std::optional<Fidelity> full;     // against the model, at the size of the photos
  std::optional<Fidelity> reduced;  // at 1/2^k of it for level k, where a viewer shows it
};

struct ExportedLevels {
  std::vector<ExportedLevel> levels;  // the finest first
  ExportedFile streamed;              // lod-meta.json; its bytes are those of all files it names
  ExportedFile rad;
};

/// Throws UsageError where the folder holds something and may not be moved aside (`force`); Error
/// where this build lacks a library. Writes nothing.
void check_export_levels(const LevelsRequest& request, bool force);

/// Builds the levels, writes the folder and measures each level where `viewpoints` are given. A
/// folder that holds something becomes FOLDER.bak-N. Throws Error, and UsageError as
/// build_lod_tree().
ExportedLevels export_levels(const GaussianModel& model, const LevelsRequest& request,
                             const Viewpoints* viewpoints = nullptr);

/// The levels as a table in Markdown, and the files.
std::string levels_table(const ExportedLevels& exported);

}  // namespace gs
