// SPDX-License-Identifier: Apache-2.0
// The one list of all fields of Config: unit, range or words, what follows when the value changes,
// meaning and source. Parsing, --set, --help, validation, printing, comparing and the docs' tables
// visit this list. A new field is one line here and one in config.h; `gemsplat config --markdown >
// docs/reference/settings.md` documents it.
#pragma once

#include <string_view>
#include <type_traits>

#include "gs_core/config/config.h"
#include "gs_core/config/config_limits.h"
#include "gs_core/density/growth_method.h"
#include "gs_core/math/constants.h"

namespace gs {

/// What follows if a setting gets another value than the one that a run began with.
enum class OnChange {
  retrain,  // the result changes: `train --resume` refuses the new value
  proceed,  // the result changes: a resumed run may have the new value for the rest of its steps
  nothing,  // the result stays the same: memory, threads, caches, logs
};

/// One field of a config with all that is known about it. T is const if the config is.
template <class T>
struct Field {
  std::string_view key;  // "section.name"
  T& value;
  std::string_view unit;  // "" for none
  Limits limits;
  OnChange on_change;
  std::string_view meaning;
  std::string_view source;  // "" for our own choice
};

// clang-format off
/// Calls visit(Field<T>) for each field of a `Config` or `const Config`, section by section. T is
/// bool, int, std::int64_t, std::uint64_t, float, std::string, std::vector<int> or an enum with
/// Words (config_words.h).
template <class AnyConfig, class Visitor>
void visit_fields(AnyConfig& config, Visitor&& visit) {
  using namespace limits;
  using enum OnChange;
  constexpr std::string_view kKerbl = "Kerbl et al. 2023", kFaster = "Faster-GS", kMip = "Yu et al. 2024",
                             kMcmc = "Kheradmand et al. 2024";
  const auto field = [&](std::string_view key, auto& value, std::string_view unit, Limits range,
                         OnChange on_change, std::string_view meaning, std::string_view source = {}) {
    visit(Field<std::remove_reference_t<decltype(value)>>{key, value, unit, range, on_change, meaning, source});
  };

  //    key                             value                         unit           limits                   changed, meaning, source
  auto& dataset = config.dataset;
  field("dataset.source",               dataset.source,               "folder",      any(),                   proceed, "the scene: photos and a COLMAP model");
  field("dataset.images",               dataset.images,               "folder",      any(),                   proceed, "the photos, inside the scene or absolute");
  field("dataset.masks",                dataset.masks,                "folder",      any(),                   retrain, "masks of the pixels that train (white), inside the scene or absolute; empty: `masks` in the scene, if there is one; none: ignore masks and alpha");
  field("dataset.mask_mode",            dataset.mask_mode,            "",            one_of<MaskMode>(),      retrain, "ignore: masked pixels do not train; background: they show the background; auto: background for Blender scenes, ignore for others");
  field("dataset.invert_masks",         dataset.invert_masks,         "",            any(),                   retrain, "in mask files, black pixels train and white ones do not");
  field("dataset.depth",                dataset.depth,                "folder",      any(),                   retrain, "depth maps that teach the model where surfaces are, inside the scene or absolute; empty: `depth` in the scene, if there is one; none: ignore maps", "docs/method/depth.md");
  field("dataset.depth_kind",           dataset.depth_kind,           "",            one_of<DepthKind>(),     retrain, "what the maps hold; metric: depth in world units; scaled: depth times an unknown factor; relative: depth up to scale and shift; inverse: inverse depth up to scale and shift, as monocular networks give it; factor, scale and shift are those of each photo; auto: the sparse points tell", "docs/method/depth.md");
  field("dataset.depth_unit",           dataset.depth_unit,           "world units", above(0),                retrain, "what one step of the integers in a PNG stands for; floats are taken as they are");
  field("dataset.normals",              dataset.normals,              "folder",      any(),                   retrain, "normal maps that teach the model how surfaces are turned, inside the scene or absolute; empty: `normals` in the scene, if there is one; none: ignore maps; read only if surface.prior_weight is above 0", "docs/method/surfaces.md#priors");
  field("dataset.normal_axes",          dataset.normal_axes,          "",            one_of<NormalAxes>(),    retrain, "the axes of the normals in these maps; world: those of the scene; else those of the camera, by letters that say where +x, +y and +z point: right, left, up, down, forward, back", "docs/method/surfaces.md#priors");
  field("dataset.model",                dataset.model,                "folder",      any(),                   proceed, "the COLMAP model; empty: sparse/0, sparse or the scene itself");
  field("dataset.lens",                 dataset.lens,                 "",            one_of<LensUse>(),       retrain, "undistort: photos become pinhole pictures; native: they train as they are, through their lens; auto: undistort, but native for lenses that see more than a pinhole can show", "docs/method/lenses.md");
  field("dataset.rolling_shutter",      dataset.rolling_shutter,      "",            any(),                   retrain, "see each row of a photo from its own pose, where transforms.json has those of the first and the last row; false: from the pose between them", "docs/method/lenses.md");
  field("dataset.resolution",           dataset.resolution,           "",            one_of_or_between("0, 1, 2, 4, 8", 16, 65536), retrain, "1, 2, 4 or 8 divides the photos' size; 16 and more is their width in pixels; 0 reduces a longer side of more than 1600 pixels to 1600", kKerbl);
  field("dataset.photo_list",           dataset.photo_list,           "file",        any(),                   retrain, "names of photos, one a line: the run uses these and no others, and only points that they show; a folder stands for all photos in it; cameras, exposures and the split stay those of the whole scene");
  field("dataset.eval",                 dataset.eval,                 "",            any(),                   retrain, "hold out every test_every-th view, sorted by name, for evaluation", kKerbl);
  field("dataset.test_every",           dataset.test_every,           "views",       steps_from(2),           retrain, "with eval, the first of every N views is held out", "Barron et al. 2022");
  field("dataset.test_names",           dataset.test_names,           "",            any(),                   retrain, "with eval, hold out these photos instead, by their names in the model, separated by commas; the ending may be left out, and a folder stands for all photos in it: cam03,cam07");
  field("dataset.times",                dataset.times,                "",            one_of<PhotoTimes>(),    retrain, "times of the photos of a COLMAP model; frames: each image is a camera that stands still, and the video or the folder of its name holds its frames; names: one camera moves, and the last number in a photo's name is its time");
  field("dataset.photo_ram_gib",        dataset.photo_ram_gib,        "GiB",         between(0, 1 << 20),     nothing, "host memory for decoded photos; photos beyond it are decoded again when they are needed; 0: half of the machine's memory");
  field("dataset.photo_cache",          dataset.photo_cache,          "folder",      any(),                   nothing, "keeps undistorted and resized photos for later runs; auto: gemsplat/photos in ~/.cache; none: photos are not kept");
  field("dataset.photo_cache_gib",      dataset.photo_cache_gib,      "GiB",         at_least(0),             nothing, "largest size of that folder; the photos used longest ago are removed first");
  field("dataset.refine_cameras",       dataset.refine_cameras,       "",            any(),                   retrain, "refine poses, lenses and points by bundle adjustment before training; needs Ceres");
  field("dataset.exposure",             dataset.exposure,             "",            any(),                   retrain, "before training, solve for each photo's brightness and white balance from the points that photos share; the model gets the scene's own colors; needs Ceres");

  auto& reconstruct = config.reconstruct;
  field("reconstruct.colmap",           reconstruct.colmap,           "file",        any(),                   proceed, "the colmap program");
  field("reconstruct.matching",         reconstruct.matching,         "",            one_of<Matching>(),      proceed, "which photos are compared: all pairs (exhaustive), neighbors by name (sequential), or each with those that look most like it (retrieval); auto: exhaustive up to 200 photos, retrieval for more, and sequential for videos");
  field("reconstruct.mapper",           reconstruct.mapper,           "",            one_of<Mapper>(),        proceed, "how cameras are placed: one after another (incremental), or all at once (global), which needs COLMAP 4; auto: global for more than 500 photos, if the program can");
  field("reconstruct.camera_model",     reconstruct.camera_model,     "",            one_of(kLensWords),      proceed, "the lens model, by COLMAP's name");
  field("reconstruct.single_camera",    reconstruct.single_camera,    "",            one_of<SingleCamera>(),  proceed, "whether all photos share one lens; auto: yes if all have the same size");
  field("reconstruct.max_features",     reconstruct.max_features,     "features",    steps_from(1),           proceed, "most features extracted from one photo", "COLMAP");
  field("reconstruct.frames",           reconstruct.frames,           "frames",      steps_from(3),           proceed, "frames taken from all videos together: the sharpest of each stretch");
  field("reconstruct.use_gpu",          reconstruct.use_gpu,          "",            any(),                   proceed, "extract and match features on the GPU, if colmap was built with CUDA");

  auto& model = config.model;
  field("model.output",                 model.output,                 "folder",      any(),                   nothing, "the run's folder: everything is written there");
  field("model.start_from",             model.start_from,             "model",       any(),                   retrain, "trained Gaussians to start from instead of the scene's points: a PLY or another file that is read, or a run's folder");
  field("model.sh_degree",              model.sh_degree,              "",            between(0, 3),           retrain, "highest degree of the spherical harmonics that hold color", kKerbl);
  field("model.initial_opacity",        model.initial_opacity,        "",            between(1e-4, 0.999),    retrain, "opacity of every Gaussian at the start", kKerbl);
  field("model.initial_scale",          model.initial_scale,          "",            above(0),                retrain, "scale of a Gaussian at the start, as a multiple of the distance to its nearest points");
  field("model.random_points",          model.random_points,          "points",      steps_from(1),           retrain, "random points to start from if the COLMAP model has none", kKerbl);
  field("model.random_box",             model.random_box,             "world units", at_least(0),             retrain, "half the edge of the box of random points, which lies around the scene's origin; 0: around what all cameras look at, or else three extents around the cameras", kKerbl);
  field("model.dynamic",                model.dynamic,                "",            any(),                   retrain, "Gaussians in space and time, for scenes that move; the photos need times (docs/reference/scenes.md)", "Yang et al. 2024");
  field("model.initial_time_scale",     model.initial_time_scale,     "duration",    above(0),                retrain, "standard deviation in time of a Gaussian at the start, if dynamic", "Yang et al. 2024");
  field("model.filter_3d",              model.filter_3d,              "",            any(),                   retrain, "widen each Gaussian by a 3D filter as wide as the finest detail that the training photos can show of it, so that close-ups have no thin artifacts; best with render.antialias; not if dynamic", kMip);

  auto& render = config.render;
  field("render.background",            render.background,            "",            one_of<Background>(),    retrain, "color behind the Gaussians; random: another color in each step", kKerbl);
  field("render.blend_rule",            render.blend_rule,            "",            one_of<BlendRule>(),     retrain, "how fragments are blended; classic: alpha is at most 0.99, and a pixel ends before the fragment that saturates it; faster_gs: after it, without that limit", kFaster);
  field("render.order",                 render.order,                 "",            one_of<RenderOrder>(),   retrain, "in which order fragments are blended; z: of the depths of their Gaussians' means; pixel: of their depths along the pixel's ray, so that nothing pops when the camera turns (docs/method/pixel_order.md); not if dynamic, not through lenses", "Radl et al. 2024");
  field("render.truncation",            render.truncation,            "",            one_of<Truncation>(),    retrain, "where a Gaussian ends: where its alpha falls below 1/255, or at 2, 3 or 4 standard deviations", kFaster);
  field("render.bounds",                render.bounds,                "",            one_of<TileBounds>(),    retrain, "which tiles list a Gaussian: the tiles that it touches, its bounding box, or a square of 3 standard deviations", kFaster);
  field("render.blend",                 render.blend,                 "",            one_of<BlendKernel>(),   retrain, "how the GPU blends: gemm on tensor cores, if there are any; simt without them", "GEMM-GS");
  field("render.antialias",             render.antialias,             "",            any(),                   retrain, "dilate splats less and compensate their opacity", kMip);
  field("render.antialias_detach",      render.antialias_detach,      "",            any(),                   retrain, "stop the gradient from that compensation to the covariance", kFaster);
  field("render.near_plane",            render.near_plane,            "world units", above(0),                retrain, "Gaussians nearer to the camera are not drawn", kKerbl);
  field("render.far_plane",             render.far_plane,             "world units", above(0),                retrain, "Gaussians farther from the camera are not drawn", kFaster);

  auto& loss = config.loss;
  field("loss.kind",                    loss.kind,                    "",            one_of(kLossWords),      retrain, "how a render is compared with its photo", "Kerbl et al. 2023, Eq. 7");
  field("loss.lambda_dssim",            loss.lambda_dssim,            "",            between(0, 1),           retrain, "weight of 1 - SSIM in the loss; L1 gets the rest", "Kerbl et al. 2023, Eq. 7");
  field("loss.depth_weight",            loss.depth_weight,            "",            at_least(0),             retrain, "weight of the depth loss at the first step, for photos with a depth map; it decays to a hundredth; 0: maps are not trained on", "docs/method/depth.md");

  auto& photometric = config.photometric;
  field("photometric.model",            photometric.model,            "",            one_of(kPhotometricWords), retrain, "what is learned of each photo, so that the scene need not explain how photos differ: gains, a gain for each photo and channel; auto, gains where photos differ in light", "docs/method/photometric.md");
  field("photometric.rate",             photometric.rate,             "1/step",      above(0),                retrain, "learning rate of these numbers after a warm-up; it falls to a hundredth", "PPISP 2026");

  auto& poses = config.poses;
  field("poses.refine",                 poses.refine,                 "",            any(),                   retrain, "also learn where each training photo was taken; for poses that are some tenths of a degree off", "docs/method/poses.md");
  field("poses.rate",                   poses.rate,                   "1/step",      above(0),                retrain, "learning rate of the poses after the warm-up, in radians and in shares of the scene's extent; it falls to a hundredth", "docs/method/poses.md");

  auto& surface = config.surface;
  field("surface.normal_weight",        surface.normal_weight,        "",            at_least(0),             retrain, "weight of the loss that turns Gaussians into the surface which their depths show; 0: none; not if dynamic", "docs/method/surfaces.md");
  field("surface.photo_weight",         surface.photo_weight,         "",            at_least(0),             retrain, "weight of the loss that moves surfaces to where patches of neighboring photos agree; 0: none; not if dynamic", "docs/method/surfaces.md");
  field("surface.prior_weight",         surface.prior_weight,         "",            at_least(0),             retrain, "weight of the loss that turns Gaussians as normal maps say; 0: none; not if dynamic", "docs/method/surfaces.md#priors");
  field("surface.from_step",            surface.from_step,            "steps",       steps_from(1),           retrain, "first step with these losses");

  auto& optimizer = config.optimizer;
  field("optimizer.position_lr_initial", optimizer.position_lr_initial, "extent",      above(0),                retrain, "learning rate of the means at the first step", kKerbl);
  field("optimizer.position_lr_final",  optimizer.position_lr_final,  "extent",      above(0),                retrain, "learning rate of the means at the last step; it falls exponentially", kKerbl);
  field("optimizer.log_scale_lr",       optimizer.log_scale_lr,       "",            at_least(0),             retrain, "learning rate of the logarithms of the scales", kKerbl);
  field("optimizer.rotation_lr",        optimizer.rotation_lr,        "",            at_least(0),             retrain, "learning rate of the quaternions", kKerbl);
  field("optimizer.opacity_lr",         optimizer.opacity_lr,         "",            at_least(0),             retrain, "learning rate of the logits of the opacities", kFaster);
  field("optimizer.sh0_lr",             optimizer.sh0_lr,             "",            at_least(0),             retrain, "learning rate of SH degree 0", kKerbl);
  field("optimizer.sh_rest_lr",         optimizer.sh_rest_lr,         "",            at_least(0),             retrain, "learning rate of SH degrees 1 to 3", kKerbl);
  field("optimizer.log_time_scale_lr",  optimizer.log_time_scale_lr,  "",            at_least(0),             retrain, "learning rate of the logarithms of the scales in time, if model.dynamic", "Yang et al. 2024");
  field("optimizer.cooldown_from",      optimizer.cooldown_from,      "steps",       steps_from(0),           retrain, "the cooldown, in which all learning rates fall, begins after this step of a 30,000-step run", "Hägele et al. 2024");
  field("optimizer.cooldown_share",     optimizer.cooldown_share,     "",            above(0),                retrain, "share of each learning rate that is left at the last step; during the cooldown the rates fall exponentially; 1: no cooldown", "docs/method/schedule.md");
  field("optimizer.moments",            optimizer.moments,            "",            one_of<MomentStorage>(), retrain, "how Adam stores the two moments of each parameter: as floats (8 bytes), or in half of the bits of one float (2 bytes), rounded at random (docs/method/moments.md)", "Gupta et al. 2015");

  auto& density = config.density;
  field("density.strategy",             density.strategy,             "",            one_of(growth_method_words()), retrain, "how Gaussians are added and removed: growth is the method of the defaults; the others are published ones, and presets have the settings that fit them (adaptive, absgs, mcmc, paper_dash to paper_taming)", "docs/method/density.md");
  field("density.from_step",            density.from_step,            "steps",       steps_from(0),           retrain, "first refinement, as a step of a 30,000-step run", kFaster);
  field("density.until_step",           density.until_step,           "steps",       steps_from(0),           retrain, "last refinement, as a step of a 30,000-step run", kFaster);
  field("density.every",                density.every,                "steps",       steps_from(1),           retrain, "interval between refinements", kKerbl);
  field("density.gradient_threshold",   density.gradient_threshold,   "NDC",         at_least(0),             retrain, "Gaussians with a smaller mean image-plane gradient do not grow", kKerbl);
  field("density.prune_opacity",        density.prune_opacity,        "",            between(0, 1),           retrain, "fainter Gaussians are removed, or moved (mcmc)", kKerbl);
  field("density.prune_scale",          density.prune_scale,          "extent",      at_least(0),             retrain, "larger Gaussians are removed, after the first opacity reset; 0: none is, so that walls and skies without points keep theirs", kKerbl);
  field("density.camera_clearance",     density.camera_clearance,     "",            between(0, 1),           retrain, "at the end, remove floaters: Gaussians that are nearer to a camera than this fraction of the depth of the sparse points around them in its photo, and that no other photo shows among its own points; 0: remove none; gemsplat edit --drop floaters=0.35 --measure shows what it would do", "docs/method/defaults.md#floaters");
  field("density.reset_opacity_every",  density.reset_opacity_every,  "steps",       steps_from(1),           retrain, "interval between the times when the method lowers opacities", kKerbl);
  field("density.reset_opacity_until",  density.reset_opacity_until,  "steps",       steps_from(0),           retrain, "last time when opacities are lowered; 0: they are not", kKerbl);
  field("density.max_gaussians",        density.max_gaussians,        "",            between(kAutoCount, 4e9), proceed, "more points are downsampled to this number, and growth stops at it; 0: no limit; auto (-1): the number that fits into memory");
  field("density.gaussians_per_point",  density.gaussians_per_point,  "",            between(0, 1e6),         retrain, "where max_gaussians is 0: the limit of the number of Gaussians, for each point that training starts from; it is at most 10 million or the number of points; 0: no limit");
  field("density.pixels_per_gaussian",  density.pixels_per_gaussian,  "pixels",      at_least(0),             retrain, "where max_gaussians is 0 and gaussians_per_point is not: that limit is at least one Gaussian for this number of pixels of the training photos, in scenes with sparse points; 0: it follows the points alone");
  field("density.region",               density.region,               "",            any(),                   retrain, "Gaussians are added only where the mean is inside of all these half-spaces, up to six: `x,y,z,d; ...` holds the points p with x p.x + y p.y + z p.z >= d, in the coordinates of the photos' poses; empty: everywhere", "docs/guide/large_scenes.md");
  field("density.growth",               density.growth,               "",            between(0, 1),           retrain, "fraction of the Gaussians that mcmc adds in one refinement", kMcmc);
  field("density.opacity_regularizer",  density.opacity_regularizer,  "",            at_least(0),             retrain, "weight of the mean opacity in the loss, so that what explains nothing fades and is removed (docs/method/defaults.md); the preset mcmc has 0.01", kMcmc);
  field("density.scale_regularizer",    density.scale_regularizer,    "1/world units", at_least(0),             retrain, "weight of the mean scale in the loss; the preset mcmc has 0.01", kMcmc);
  field("density.time_scale_regularizer", density.time_scale_regularizer, "duration",  at_least(0),             retrain, "if model.dynamic, weight in the loss of the mean of 1 / scale in time, so that Gaussians live long");
  field("density.velocity_regularizer", density.velocity_regularizer, "(duration/world units)^2", at_least(0),  retrain, "if model.dynamic, weight in the loss of the mean squared velocity");

  auto& train = config.train;
  field("train.iterations",             train.iterations,             "steps",       steps_from(0),           proceed, "length of the training, one photo each step; the schedule scales with it; 0: as epochs, least_iterations, most_iterations and random_start_factor say");
  field("train.epochs",                 train.epochs,                 "epochs",      between(0, 100000),      retrain, "if iterations is 0, the number of passes over the photos");
  field("train.least_iterations",       train.least_iterations,       "steps",       steps_from(0),           retrain, "if iterations is 0, the smallest number of steps");
  field("train.most_iterations",        train.most_iterations,        "steps",       steps_from(1),           retrain, "if iterations is 0, the largest number of steps");
  field("train.random_start_factor",    train.random_start_factor,    "",            above(0),                retrain, "factor of epochs, least_iterations and most_iterations where training starts from random points");
  field("train.batch",                  train.batch,                  "photos",      between(1, kMostBatch),  retrain, "photos of one update, which takes the mean of their gradients; steps go on counting photos", "Faster-GS (4D)");
  field("train.batch_rates",            train.batch_rates,            "",            any(),                   retrain, "an update by B photos stands for B updates: learning rates * sqrt(B), betas to the power B; off: as for one photo", "Malladi et al. 2022");
  field("train.steps_scaler",           train.steps_scaler,           "",            above(0),                retrain, "multiplies iterations, and with it the schedule");
  field("train.sh_degree_every",        train.sh_degree_every,        "steps",       steps_from(1),           retrain, "interval between SH degrees, in steps of a 30,000-step run", kKerbl);
  field("train.resolution_ramp",        train.resolution_ramp,        "",            between(1, kMostReduction), retrain, "train on photos reduced by these factors first, such as [4, 2]; empty: on whole photos from the start");
  field("train.resolution_every",       train.resolution_every,       "steps",       steps_from(1),           retrain, "how long each factor of the ramp lasts, in steps of a 30,000-step run");
  field("train.resolution_least",       train.resolution_least,       "pixels",      steps_from(1),           retrain, "the ramp reduces no photo to fewer pixels; a smaller factor replaces one that would");
  field("train.seed",                   train.seed,                   "",            between(0, kLargestExact), retrain, "the same seed gives the same bytes on the CPU, and on a GPU with train.deterministic");
  field("train.deterministic",          train.deterministic,          "",            any(),                   retrain, "on a GPU, sum in a fixed order, so that the same seed gives the same bytes; slower");
  field("train.threads",                train.threads,                "",            between(0, 4096),        nothing, "CPU threads; 0: all cores; the result does not depend on it");
  field("train.device",                 train.device,                 "",            one_of(kDeviceWords),    proceed, "where to train; cuda:N is the GPU with that number");
  field("train.ranks",                  train.ranks,                  "",            between(1, 64),          nothing, "number of GPUs, from train.device on, that train one model together (docs/guide/several_gpus.md); the result does not depend on it with train.deterministic");
  field("train.photo_gib",              train.photo_gib,              "GiB",         at_least(0),             nothing, "GPU memory for photos; photos that do not fit are copied one step ahead");
  field("train.extra_steps",            train.extra_steps,            "steps",       steps_from(0),           proceed, "added after the schedule's last step, at its final learning rates; not scaled; --iterations +N sets it for a finished run");
  field("train.checkpoint_every",       train.checkpoint_every,       "steps",       steps_from(-1),          nothing, "interval between checkpoints; 0: one minute, or longer if that would cost over 1 % of the time; -1: only when the run is stopped");
  field("train.log_every",              train.log_every,              "steps",       steps_from(1),           nothing, "interval between rows of metrics.csv");
  field("train.save_steps",             train.save_steps,             "steps",       steps_from(1),           proceed, "also save the PLY after these steps; not scaled");
  field("train.test_steps",             train.test_steps,             "steps",       steps_from(1),           proceed, "also evaluate the test views after these steps; not scaled");

  auto& eval = config.eval;
  field("eval.lpips",                   eval.lpips,                   "file",        any(),                   proceed, "also measure LPIPS at the end of a run, with the weights in this file (docs/method/equations.md says how to make it); none: it is not measured", "Zhang et al. 2018");
  field("eval.color_corrected",         eval.color_corrected,         "",            any(),                   proceed, "also measure pictures whose colors are fitted to the photo (psnr_cc); always on with photometric.model", "Mildenhall et al. 2022");
}
// clang-format on

}  // namespace gs
