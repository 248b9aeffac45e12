// SPDX-License-Identifier: Apache-2.0
// The results of a run as numbers: results.json, per_view.json, and evaluations of views.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "gs_eval/metrics.h"
#include "gs_train/backend.h"
#include "gs_train/poses/poses.h"

namespace gs {

inline constexpr std::size_t kTrainViewsShown = 8;  // training views in results.json

/// The results of one training run, with the fields of results.json.
struct Results {
  int iterations = 0;
  std::size_t num_gaussians = 0;
  std::size_t removed_floaters = 0;  // at the end (gs_train/density/floaters.h)
  double train_seconds = 0;
  // How long each part of the command took, seconds of the clock on the wall, in order
  std::vector<std::pair<std::string, double>> wall_seconds;
  Evaluation test, train;  // train: of a few views, evenly chosen
  std::string device;
  std::uint64_t seed = 0;
  std::optional<std::size_t> peak_gpu_bytes;  // of a run on a GPU
  std::optional<double> forecast_gpu_bytes;   // what training_bytes() gives for this run
  std::string scene_hash;
  Vec3d world_offset{0.0, 0.0, 0.0};           // as in Scene
  std::optional<CameraRefinement> refinement;  // where cameras were refined
  std::optional<ExposureSummary> exposure;     // where exposures were solved for
  std::optional<SceneLooks> looks;             // of a photometric model
  std::optional<PoseChange> poses;             // where poses were refined
};

/// The most GPU memory that this process has held so far, in bytes; none for a CPU backend.
std::optional<std::size_t> peak_gpu_bytes(Backend& backend);
/// The GPU memory that it holds now.
std::optional<std::size_t> gpu_bytes(Backend& backend);

/// {"iterations", "num_gaussians", "removed_floaters", "train_seconds", "wall_seconds": {"start",
/// ...}, "test": {"psnr", "ssim", "flip", "num_views"}, "train": {...}, "device", "version", "seed", "commit", "cpu", "date",
/// "scene_hash", "peak_host_bytes", "compiler"}; "cuda" of a build with CUDA, "uncommitted" of one
/// with uncommitted changes (their hash); "test" is null where no view was held out, and "flip"
/// is there where it was measured. So is "lpips", with "lpips_network": {"name",
/// "file", "hash"} beside "test". On a GPU "peak_gpu_bytes", "forecast_gpu_bytes" and "driver",
/// too. Date and peak are those of the call
/// (provenance.h). "world_offset" where it is not 0. Where cameras were refined, "refinement" has
/// the fields of CameraRefinement. Where views have exposures, "test" and "train" also hold each
/// metric as "psnr_exposure" and so on, and "exposure" is {"samples", "spread_before",
/// "spread_after"}. With a photometric model "test" and "train" hold PSNR and SSIM as
/// "psnr_photometric" (the picture as the photo shows it: predicted in "test", learned in "train")
/// and "psnr_cc" (the picture with colors fitted to the photo), and "photometric" is {"model",
/// "rule", "spreads"}. Where poses were refined while training, "poses" has the fields of
/// PoseChange, and "train" is measured at the refined poses. Where views are panoramas, "test" also
/// holds "psnr_panorama", "ssim_panorama" and "ws_psnr" of the whole panoramas, and each front half
/// in per_view.json. Where views have depth maps, "test"
/// and "train" hold "depth_error", the mean relative error of the rendered depth
/// (metrics/depth_error.h). Of runs with surface terms they hold "normal_angle", the mean angle in
/// degrees between normals and the surface (gs_eval/normal_angle.h).
std::string results_json(const Results& results);

/// {"test": {"name": {"psnr", "ssim", "flip", "lpips"}, ...}, "train": {...}}
std::string per_view_json(const Results& results);

/// {"psnr", "ssim", "flip", "num_views", "views": {name: {"psnr", ...}, ...}} and more
/// for `gemsplat eval --json`.
std::string evaluation_json(const Evaluation& evaluation, const std::string& model,
                            const std::string& split, std::size_t num_gaussians,
                            const std::string& device);

/// "28.93 dB PSNR, 0.9312 SSIM, 0.0712 FLIP over 7 views", with the metrics that
/// were measured (LPIPS after FLIP). For views with exposures PSNR and SSIM under these exposures
/// follow.
std::string summary(const Evaluation& evaluation);

}  // namespace gs
