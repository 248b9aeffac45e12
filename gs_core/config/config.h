// SPDX-License-Identifier: Apache-2.0
// Everything that a run can be told. Defaults stand here and nowhere else. config_fields.h lists
// each field once with its unit, range, meaning and source; parsing, --set, --help, validation and
// printing visit that list.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "gs_core/config/config_words.h"

namespace gs {

/// Which photos and cameras to train on.
struct DatasetConfig {
  std::string source;             // the scene's folder
  std::string images = "images";  // the photos' folder inside it, or an absolute path
  std::string masks;  // the masks' folder; empty: `masks` in the scene; none: no masks, no alpha
  MaskMode mask_mode = MaskMode::automatic;
  bool invert_masks = false;  // in mask files, black trains and white does not
  // The folder of depth maps; empty: `depth` in the scene; none: no maps (docs/method/depth.md)
  std::string depth;
  DepthKind depth_kind = DepthKind::automatic;
  float depth_unit = 1e-3f;  // world units of a step of the integers in PNG files
  // The folder of normal maps; empty: `normals` in the scene; none: no maps
  std::string normals;
  NormalAxes normal_axes = NormalAxes::world;
  std::string model;  // the COLMAP model's folder; empty: sparse/0, sparse or the scene itself
  LensUse lens = LensUse::automatic;  // undistort, except for lenses too wide for that
  bool rolling_shutter = true;
  int resolution = 0;  // 1, 2, 4, 8: divides the photos' size; 16 and more: the width in pixels;
                       // 0: kUsualSide for the longer side of larger photos
  std::string photo_list;  // a file with names of photos: the run uses no others; empty: all
  bool eval = false;       // hold out every test_every-th view, sorted by name
  int test_every = 8;
  std::string test_names;               // photos or cameras held out instead, separated by commas
  PhotoTimes times = PhotoTimes::none;  // of photos in scenes of COLMAP
  float photo_ram_gib = 0;              // for decoded photos; 0: half of the machine's memory
  std::string photo_cache = "auto";     // folder of undistorted and resized photos; auto, none
  float photo_cache_gib = 20;           // most in that folder
  bool refine_cameras = false;          // bundle adjustment before training
  bool exposure = false;  // solve for each photo's exposure and white balance before training
};

/// How the colmap program finds where photos were taken.
struct ReconstructConfig {
  std::string colmap = "colmap";  // the program
  Matching matching = Matching::automatic;
  Mapper mapper = Mapper::automatic;
  std::string camera_model = "SIMPLE_RADIAL";  // COLMAP's name
  SingleCamera single_camera = SingleCamera::automatic;
  int max_features = 8192;  // in one photo
  int frames = 200;         // taken from all videos together
  bool use_gpu = true;      // if the program was built with CUDA
};

/// What is learned, and where it starts.
struct ModelConfig {
  std::string output;  // the run's folder
  // a model to start from, a file or a run's folder; empty: the scene's points
  std::string start_from;
  int sh_degree = 3;
  float initial_opacity = 0.1f;
  float initial_scale = 1;           // times the distance to the nearest points
  int random_points = 15000;         // used when the model has no points
  float random_box = 0;              // half the edge of the box of random points; 0: by cameras
  bool dynamic = false;              // Gaussians in space and time, for scenes that move
  float initial_time_scale = 0.45f;  // standard deviation, as a fraction of the scene's duration
  bool filter_3d = false;  // no Gaussian is smaller than the photos can show (Mip-Splatting)
};

/// How Gaussians are drawn; gs_render/render_settings.h turns it into what the renderer takes.
struct RenderConfig {
  Background background = Background::black;
  BlendRule blend_rule = BlendRule::faster_gs;
  RenderOrder order = RenderOrder::z;
  Truncation truncation = Truncation::alpha;
  TileBounds bounds = TileBounds::exact;
  BlendKernel blend = BlendKernel::gemm;
  bool antialias = false;
  bool antialias_detach = true;  // no gradient from the opacity compensation to the covariance
  float near_plane = 0.2f;
  float far_plane = 1e4f;
};

struct LossConfig {
  std::string kind = "l1_ssim";  // l1_ssim
  float lambda_dssim = 0.2f;
  float depth_weight = 0.5f;  // of the depth loss at the first step, where there are maps
};

/// How photos that differ in exposure and white balance are explained (docs/method/photometric.md).
struct PhotometricConfig {
  std::string model = "none";  // none, gains, auto
  float rate = 5e-3f;          // Adam's, of its numbers
};

/// Poses of the training photos, refined while training (docs/method/poses.md).
struct PosesConfig {
  bool refine = false;
  float rate = 1e-4f;  // Adam's, of radians and of shares of the scene's extent
};

/// Gaussians that lie on the surfaces which they show (docs/method/surfaces.md).
struct SurfaceConfig {
  float normal_weight = 0;  // of the loss of normals
  float photo_weight = 0;   // of the loss of neighboring photos
  float prior_weight = 0;   // of the loss of normal maps
  int from_step = 7000;     // of a 30,000-step run: the first step with them

  bool is_on() const { return normal_weight > 0 || photo_weight > 0 || prior_weight > 0; }
};

/// Learning rates of Adam; position rates are multiplied by the scene's extent.
struct OptimizerConfig {
  float position_lr_initial = 1.6e-4f;
  float position_lr_final = 1.6e-5f;
  float log_scale_lr = 0.01f;
  float rotation_lr = 1e-3f;
  float opacity_lr = 0.025f;
  float sh0_lr = 2.5e-3f;
  float sh_rest_lr = 2.5e-4f;
  float log_time_scale_lr = 5e-3f;
  int cooldown_from = 24000;     // all rates fall from this step on, ...
  float cooldown_share = 0.03f;  // ... to this share of themselves at the last one; 1: they do not
  MomentStorage moments = MomentStorage::halves;
};

inline constexpr int kMostReduction = 16;       // of photos, in each direction
inline constexpr int kMostPoints = 2'000'000;   // to start from; denser clouds are downsampled
inline constexpr std::int64_t kAutoCount = -1;  // the word auto: the program finds the count itself

/// Density control: a method, whose constants are in gs_core/density, and what fits it to a scene.
/// Steps are those of a 30,000-step run. The presets have the settings that fit other methods than
/// growth.
struct DensityConfig {
  std::string strategy = "growth";  // a method: growth_method() in gs_core/density
  int from_step = 600;
  int until_step = 24000;
  int every = 100;
  float gradient_threshold = 1e-4f;  // of the mean NDC-scaled 2D position gradient
  float prune_opacity = 0.005f;
  float prune_scale = 0;       // of the extent, after the first opacity reset; 0: none
  float camera_clearance = 0;  // of the depth of the points behind a Gaussian; 0: none
  int reset_opacity_every = 6000;
  int reset_opacity_until = 24000;
  std::int64_t max_gaussians = 0;   // 0: no cap; kAutoCount: as many as fit into memory
  float gaussians_per_point = 27;   // where there is no cap: so many for each sparse point, ...
  float pixels_per_gaussian = 100;  // ... and at least one for so many pixels of the photos
  std::string region;  // half-spaces, inside of which Gaussians are added; empty: everywhere
  // for mcmc only
  float growth = 0.05f;  // of the count, in one refinement
  // for all methods
  float opacity_regularizer = 0.001f;  // weight of the mean opacity in the loss
  float scale_regularizer = 0;         // weight of the mean scale in the loss
  float time_scale_regularizer = 0;    // weight of the mean of 1 / scale in time
  float velocity_regularizer = 0;      // weight of the mean squared velocity
};

struct TrainConfig {
  int iterations = 0;                // 0: as the next four say
  int epochs = 100;                  // passes over the photos, ...
  int least_iterations = 5000;       // ... but at least ...
  int most_iterations = 20000;       // ... and at most so many steps
  float random_start_factor = 2.5f;  // times these three where training starts from random points
  int batch = 1;                     // photos of one update; steps count photos
  bool batch_rates = true;           // learning rates and betas that fit the batch
  float steps_scaler = 1;            // multiplies iterations and the whole schedule
  int sh_degree_every = 3000;
  std::vector<int> resolution_ramp{2};  // factors by which photos are reduced at first
  int resolution_every = 6000;          // steps with each of them
  int resolution_least = 100000;        // pixels; a photo is not reduced to fewer
  std::uint64_t seed = 42;
  int threads = 0;              // 0: all cores
  bool deterministic = false;   // the same seed gives the same bytes on a GPU, too
  std::string device = "auto";  // cpu, cuda, cuda:N, auto
  int ranks = 1;                // GPUs that train one model together, from `device` on
  float photo_gib = 4;          // GPU memory for photos; others are copied when they are needed
  int extra_steps = 0;          // after the schedule's last step, at its final rates
  int checkpoint_every = 0;     // steps; 0: about a minute; -1: only when the run is stopped
  int log_every = 100;
  std::vector<int> save_steps;  // besides the last one
  std::vector<int> test_steps;  // besides the last one
};

/// The evaluation at the end of a run, and by `gemsplat eval`.
struct EvalConfig {
  std::string lpips;  // weights of the network of LPIPS, a file; empty, none: it is not measured
  bool color_corrected = false;  // also measure pictures with colors fitted to the photos
};

struct Config {
  DatasetConfig dataset;
  ReconstructConfig reconstruct;
  ModelConfig model;
  RenderConfig render;
  LossConfig loss;
  PhotometricConfig photometric;
  PosesConfig poses;
  SurfaceConfig surface;
  OptimizerConfig optimizer;
  DensityConfig density;
  TrainConfig train;
  EvalConfig eval;
};

/// Where values come from, by key: "runs/a.toml:3", "preset fast:3", "--set", "flag". Settings with
/// their default value have no entry.
using SettingOrigins = std::map<std::string, std::string, std::less<>>;

/// Merges a config into `config`. `name` is a TOML file, a run's folder or a preset
/// (config_source.h); its `base` is merged first. Settings of older versions that change nothing
/// are read over (removed_settings.h). `origins`, if given, notes where each value came from.
/// Throws UsageError, which names file, line, key and the nearest known key, and Error for a file
/// that cannot be read.
void load_config(Config& config, const std::filesystem::path& name,
                 SettingOrigins* origins = nullptr);

/// Applies one `section.key=value`. The value has TOML syntax; a bare word is a string. Returns the
/// key. Throws UsageError, which names the key and the nearest known one, or the value and its
/// range.
std::string apply_setting(Config& config, const std::string& assignment);

/// Checks every field against its range. Throws UsageError, which names the field, the value, the
/// range and, if `origins` has it, where the value comes from.
void validate(const Config& config, const SettingOrigins& origins = {});

/// Throws the UsageError for an unknown setting; the message names the nearest known one. `where`:
/// "file:line: " or empty.
[[noreturn]] void refuse_key(std::string_view where, const std::string& key);

/// The whole config as TOML, each field with its unit and meaning as a comment. load_config() reads
/// it back.
std::string to_toml(const Config& config);

}  // namespace gs
