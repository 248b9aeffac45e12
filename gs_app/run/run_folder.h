// SPDX-License-Identifier: Apache-2.0
// The folder of one run. Its layout is that of the reference trainer (Kerbl et al. 2023), which
// other viewers expect, with our own files besides. docs/reference/run_folder.md lists them.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {

/// Paths inside a run's folder.
class RunFolder {
 public:
  using Path = std::filesystem::path;
  explicit RunFolder(Path root) : root_(std::move(root)) {}

  const Path& root() const { return root_; }
  Path ply(int step) const;
  Path raw_ply(int step) const;  // beside it, of runs with a 3D filter: before that was applied
  Path pictures(std::string_view split, int step) const;  // holds renders/ and gt/
  Path checkpoints() const { return root_ / "checkpoints"; }
  Path cameras() const { return root_ / "cameras.json"; }
  Path cfg_args() const { return root_ / "cfg_args"; }
  Path config() const { return root_ / "config.toml"; }
  Path input_points() const { return root_ / "input.ply"; }
  Path exposures() const { return root_ / "exposure.json"; }
  Path photometric() const { return root_ / "photometric.json"; }
  Path poses() const { return root_ / "poses.json"; }
  Path refined_model() const { return root_ / "sparse" / "0"; }
  Path world_offset() const { return root_ / "world_offset.json"; }
  Path split() const { return root_ / "split.json"; }
  Path metrics() const { return root_ / "metrics.csv"; }
  Path profile() const { return root_ / "profile.csv"; }
  Path results() const { return root_ / "results.json"; }
  Path per_view() const { return root_ / "per_view.json"; }
  Path comparison() const { return root_ / "comparison.png"; }
  Path report() const { return root_ / "report.html"; }

  /// Whether any file that a run writes is there.
  bool holds_run() const;
  /// The largest N with a point_cloud/iteration_N/point_cloud.ply.
  std::optional<int> newest_step() const;

 private:
  Path root_;
};

/// The files and folders that settings name for a command to read. None of them is ever moved.
std::vector<std::filesystem::path> inputs_of(const Config& config);

/// Throws UsageError if the folder's path is that of a file.
void check_is_folder(const RunFolder& folder);

/// Throws UsageError if the folder holds a run already, unless `force` is set and the folder may be
/// moved: no path of `needed` lies in it.
void check_is_free(const RunFolder& folder, bool force,
                   const std::vector<std::filesystem::path>& needed);

/// If the folder, whose lock this is, holds a run, moves it to ROOT.bak-N, so that nothing is lost,
/// and makes it anew. Throws UsageError if a path of `needed` lies in it.
void move_run_aside(const RunFolder& folder, OutputLock& lock,
                    const std::vector<std::filesystem::path>& needed);

/// Writes what is known before the first step: config.toml, cfg_args, split.json, cameras.json and
/// input.ply; also exposure.json if exposures were computed, and world_offset.json if there is an
/// offset.
void write_run_description(const RunFolder& folder, const Config& config, const Scene& scene);

/// The names of the run's views in a split, "train" or "test", as split.json has them. Throws
/// Error.
std::vector<std::string> split_names(const RunFolder& folder, const std::string& split);

/// Whether a file is there with this text.
bool holds_text(const std::filesystem::path& path, std::string_view text);

/// Writes a text file, whole or not at all. Throws Error.
void write_text(const std::filesystem::path& path, std::string_view text);

}  // namespace gs
