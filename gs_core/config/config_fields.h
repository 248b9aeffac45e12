// SPDX-License-Identifier: Apache-2.0
// Every field of Config, once, with its unit, range or words, meaning and source. Parsing, --set, --help,
// validation, printing and the docs' table are visitors over this list; a new field is one line here and
// one in config.h.
#pragma once

#include <string_view>
#include <type_traits>

#include "gs_core/config/config.h"
#include "gs_core/config/config_limits.h"

namespace gs {

/// One field of a config and all there is to say of it. T is const where the config is.
template <class T>
struct Field {
  std::string_view key;  // "section.name"
  T& value;
  std::string_view unit;  // "" for none
  Limits limits;
  std::string_view meaning;
  std::string_view source;  // "" for our own choice
};

// clang-format off
/// Calls visit(Field<T>) for each field of a `Config` or `const Config`, section by section. T is one of
/// bool, int, std::int64_t, std::uint64_t, float, std::string, std::vector<int>.
template <class AnyConfig, class Visitor>
void visit_fields(AnyConfig& config, Visitor&& visit) {
  using namespace limits;
  constexpr std::string_view kKerbl = "Kerbl et al. 2023", kFaster = "Faster-GS", kMip = "Yu et al. 2024",
                             kMcmc = "Kheradmand et al. 2024";
  const auto field = [&](std::string_view key, auto& value, std::string_view unit, Limits range,
                         std::string_view meaning, std::string_view source = {}) {
    visit(Field<std::remove_reference_t<decltype(value)>>{key, value, unit, range, meaning, source});
  };

  //    key                             value                         unit      limits              meaning, source
  auto& dataset = config.dataset;
  field("dataset.source",               dataset.source,               "folder", any(),              "the scene: photos and a COLMAP model");
  field("dataset.images",               dataset.images,               "folder", any(),              "the photos, inside the scene or absolute");
  field("dataset.masks",                dataset.masks,                "folder", any(),              "which pixels train (white), inside the scene or absolute; empty: `masks`, where there is one; none: no masks, no alpha");
  field("dataset.mask_mode",            dataset.mask_mode,            "",       one_of("auto, ignore, background"), "masked pixels are ignored, or show the background; auto: background in Blender scenes");
  field("dataset.invert_masks",         dataset.invert_masks,         "",       any(),              "in mask files, black trains and white does not");
  field("dataset.model",                dataset.model,                "folder", any(),              "the COLMAP model; empty: sparse/0, sparse or the scene itself");
  field("dataset.resolution",           dataset.resolution,           "",       between(1, 65536),  "1, 2, 4, 8: photos divided by it; 16 and more: their width in pixels", kKerbl);
  field("dataset.eval",                 dataset.eval,                 "",       any(),              "hold out every test_every-th view, by sorted name, to measure on", kKerbl);
  field("dataset.test_every",           dataset.test_every,           "views",  steps_from(2),      "with eval, one of so many views is held out, the first among them", "Barron et al. 2022");
  field("dataset.photo_ram_gib",        dataset.photo_ram_gib,        "GiB",    at_least(0),        "of host memory for decoded photos; more are decoded again when they are needed; 0: half of the machine's");
  field("dataset.photo_cache",          dataset.photo_cache,          "folder", any(),              "keeps undistorted or resized photos for later runs; auto: gemsplat/photos in ~/.cache; none: nowhere");
  field("dataset.photo_cache_gib",      dataset.photo_cache_gib,      "GiB",    at_least(0),        "of disk for that folder; what was used longest ago makes room");
  field("dataset.refine_cameras",       dataset.refine_cameras,       "",       any(),              "refine poses, lenses and points before training, so that points land where the photos show them; needs Ceres");
  field("dataset.exposure",             dataset.exposure,             "",       any(),              "solve for each photo's brightness and white balance from the points that photos share, and train on the scene's own colors; needs Ceres");

  auto& reconstruct = config.reconstruct;
  field("reconstruct.colmap",           reconstruct.colmap,           "file",   any(),              "the colmap program");
  field("reconstruct.matching",         reconstruct.matching,         "",       one_of("auto, exhaustive, sequential"), "which photos are compared: all, or neighbors by name; auto: all of up to 200, neighbors of a video");
  field("reconstruct.camera_model",     reconstruct.camera_model,     "",       one_of("SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE"), "the lens, as COLMAP calls it");
  field("reconstruct.single_camera",    reconstruct.single_camera,    "",       one_of("auto, yes, no"), "one lens for all photos; auto: if all have the same size");
  field("reconstruct.max_features",     reconstruct.max_features,     "features", steps_from(1),    "in one photo", "COLMAP");
  field("reconstruct.frames",           reconstruct.frames,           "frames", steps_from(3),      "taken out of videos, all together: the sharpest of each of so many stretches");
  field("reconstruct.use_gpu",          reconstruct.use_gpu,          "",       any(),              "SIFT on the GPU; needs a colmap with CUDA");

  auto& model = config.model;
  field("model.output",                 model.output,                 "folder", any(),              "where the run is written");
  field("model.start_from",             model.start_from,             "model",  any(),              "trained Gaussians to start from instead of the scene's points: a PLY or another file that is read, or a run's folder");
  field("model.sh_degree",              model.sh_degree,              "",       between(0, 3),      "highest degree of the spherical harmonics that hold color", kKerbl);
  field("model.initial_opacity",        model.initial_opacity,        "",       between(1e-4, 0.999), "of every Gaussian at the start", kKerbl);
  field("model.initial_scale",          model.initial_scale,          "",       above(0),           "of the distance to the nearest points, the scale of a Gaussian at the start");
  field("model.random_points",          model.random_points,          "points", steps_from(1),      "drawn where the COLMAP model has no points", kKerbl);
  field("model.most_points",            model.most_points,            "points", steps_from(1),      "to start from; of a denser COLMAP model one point of each cell of a grid is taken");

  auto& render = config.render;
  field("render.background",            render.background,            "",       one_of("black, white, random"), "behind the Gaussians; random: another color each step", kKerbl);
  field("render.blend_rule",            render.blend_rule,            "",       one_of("faster_gs, classic"), "classic: alpha at most 0.99, a pixel ends before its last fragment", kFaster);
  field("render.truncation",            render.truncation,            "",       one_of("alpha, sigma2, sigma3, sigma4"), "where a Gaussian ends: at alpha 1/255, or at so many standard deviations", kFaster);
  field("render.bounds",                render.bounds,                "",       one_of("exact, box, square"), "which tiles list a Gaussian: those it hits, its bounding box, a square of 3 standard deviations", kFaster);
  field("render.blend",                 render.blend,                 "",       one_of("gemm, simt"), "on CUDA: gemm blends on tensor cores, where there are any", "GEMM-GS");
  field("render.precision",             render.precision,             "",       one_of("full, half"), "half: pictures to look at with weights of 11 bits; training is always full");
  field("render.antialias",             render.antialias,             "",       any(),              "smaller dilation with opacity compensation", kMip);
  field("render.antialias_detach",      render.antialias_detach,      "",       any(),              "no gradient from that compensation to the covariance", kFaster);
  field("render.near_plane",            render.near_plane,            "world units", above(0),         "nothing nearer is drawn", kKerbl);
  field("render.far_plane",             render.far_plane,             "world units", above(0),         "nothing farther is drawn", kFaster);

  auto& loss = config.loss;
  field("loss.lambda_dssim",            loss.lambda_dssim,            "",       between(0, 1),      "weight of 1 - SSIM; the rest is L1", "Kerbl et al. 2023, Eq. 7");

  auto& optimizer = config.optimizer;
  field("optimizer.position_lr_initial", optimizer.position_lr_initial, "extent", above(0),         "Adam rate of the means at the first step", kKerbl);
  field("optimizer.position_lr_final",  optimizer.position_lr_final,  "extent", above(0),           "and at the last; exponential between", kKerbl);
  field("optimizer.log_scale_lr",       optimizer.log_scale_lr,       "",       at_least(0),        "Adam rate of the logarithms of the scales", kKerbl);
  field("optimizer.rotation_lr",        optimizer.rotation_lr,        "",       at_least(0),        "Adam rate of the quaternions", kKerbl);
  field("optimizer.opacity_lr",         optimizer.opacity_lr,         "",       at_least(0),        "Adam rate of the logits of the opacities", kFaster);
  field("optimizer.sh0_lr",             optimizer.sh0_lr,             "",       at_least(0),        "Adam rate of SH degree 0", kKerbl);
  field("optimizer.sh_rest_lr",         optimizer.sh_rest_lr,         "",       at_least(0),        "Adam rate of SH degrees 1 to 3", kKerbl);

  auto& density = config.density;
  field("density.strategy",             density.strategy,             "",       one_of("adaptive, mcmc"), "how Gaussians are added and removed: cloned, split and pruned; or moved and drawn as samples (needs max_gaussians)");
  field("density.from_step",            density.from_step,            "steps",  steps_from(0),      "first refinement (clone, split, prune; move, add), of a 30,000-step run", kFaster);
  field("density.until_step",           density.until_step,           "steps",  steps_from(0),      "last refinement", kFaster);
  field("density.every",                density.every,                "steps",  steps_from(1),      "between refinements", kKerbl);
  field("density.gradient_threshold",   density.gradient_threshold,   "NDC",    at_least(0),        "mean image-plane gradient above which a Gaussian is cloned or split", kKerbl);
  field("density.small_scale",          density.small_scale,          "extent", at_least(0),        "smaller Gaussians are cloned, larger ones split", kKerbl);
  field("density.prune_opacity",        density.prune_opacity,        "",       between(0, 1),      "fainter Gaussians are removed, or moved by mcmc", kKerbl);
  field("density.prune_scale",          density.prune_scale,          "extent", above(0),           "larger Gaussians are removed, after the first opacity reset", kKerbl);
  field("density.camera_clearance",     density.camera_clearance,     "",       between(0, 1),      "in the end Gaussians nearer to a camera than this share of the way to the nearest sparse points in its picture are removed; 0: none", "docs/benchmarks.md#floaters");
  field("density.reset_opacity_every",  density.reset_opacity_every,  "steps",  steps_from(1),      "between opacity resets", kKerbl);
  field("density.reset_opacity_until",  density.reset_opacity_until,  "steps",  steps_from(0),      "last opacity reset; 0: none", kKerbl);
  field("density.max_gaussians",        density.max_gaussians,        "",       between(kAutoCount, 4e9), "no growth beyond so many, however many points there are; 0: no cap; auto (-1): as many as there is memory for");
  field("density.absolute_gradient",    density.absolute_gradient,    "",       any(),              "the gradient that decides about growth sums absolute values over pixels; wants a threshold some four times as large", "Ye et al. 2024");
  field("density.growth",               density.growth,               "",       between(0, 1),      "of the Gaussians, added in one refinement of mcmc", kMcmc);
  field("density.noise_scale",          density.noise_scale,          "",       at_least(0),        "of mcmc's noise on the means, times their learning rate", kMcmc);
  field("density.opacity_regularizer",  density.opacity_regularizer,  "",       at_least(0),        "weight of the mean opacity in mcmc's loss", kMcmc);
  field("density.scale_regularizer",    density.scale_regularizer,    "1/world units", at_least(0), "weight of the mean scale in mcmc's loss", kMcmc);

  auto& train = config.train;
  field("train.iterations",             train.iterations,             "steps",  steps_from(1),      "of training, one photo each; the schedule scales with it", kKerbl);
  field("train.steps_scaler",           train.steps_scaler,           "",       above(0),           "multiplies iterations");
  field("train.sh_degree_every",        train.sh_degree_every,        "steps",  steps_from(1),      "between SH degrees, of a 30,000-step run", kKerbl);
  field("train.morton_every",           train.morton_every,           "steps",  steps_from(1),      "between sorts along the Morton curve", kFaster);
  field("train.morton_until",           train.morton_until,           "steps",  steps_from(0),      "last such sort but the final one", kFaster);
  field("train.seed",                   train.seed,                   "",       between(0, kLargestExact), "same seed, same bytes on the CPU, and on a GPU with train.deterministic");
  field("train.deterministic",          train.deterministic,          "",       any(),              "on a GPU: sums that do not depend on their order, so that the same seed gives the same bytes; slower");
  field("train.threads",                train.threads,                "",       between(0, 4096),   "of the CPU; 0: all cores; the result does not depend on it");
  field("train.device",                 train.device,                 "",       one_of("auto, cpu, cuda, cuda:N"), "where to train");
  field("train.photo_gib",              train.photo_gib,              "GiB",    at_least(0),        "of GPU memory for photos; those that do not fit are fetched one step ahead");
  field("train.extra_steps",            train.extra_steps,            "steps",  steps_from(0),      "after the last of the schedule, at its final rates; --iterations +N of a finished run; not scaled");
  field("train.checkpoint_every",       train.checkpoint_every,       "steps",  steps_from(-1),     "between checkpoints; 0: every minute, or less often where that would cost over 1 % of the time; -1: only when the run is stopped");
  field("train.log_every",              train.log_every,              "steps",  steps_from(1),      "between rows of metrics.csv");
  field("train.save_steps",             train.save_steps,             "steps",  steps_from(1),      "after which the PLY is saved, besides the last; not scaled");
  field("train.test_steps",             train.test_steps,             "steps",  steps_from(1),      "after which the test views are evaluated, besides the last; not scaled");
}
// clang-format on

}  // namespace gs
