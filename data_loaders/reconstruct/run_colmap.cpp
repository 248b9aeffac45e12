// SPDX-License-Identifier: Apache-2.0
// COLMAP's stages one after another; colmap_plan.h decides what they do.
#include "data_loaders/reconstruct/run_colmap.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>
#include <cstring>
#include <fstream>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/colmap/colmap_write.h"
#include "data_loaders/foreign/foreign_scene.h"
#include "data_loaders/reconstruct/colmap_commands.h"
#include "data_loaders/reconstruct/colmap_log.h"
#include "data_loaders/reconstruct/colmap_plan.h"
#include "data_loaders/reconstruct/colmap_verdict.h"
#include "data_loaders/reconstruct/foreign_cameras.h"
#include "data_loaders/reconstruct/panorama_views.h"
#include "data_loaders/reconstruct/scene_state.h"
#include "data_loaders/reconstruct/take_pictures.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/processes/subprocess.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLinesShown = 8;  // of COLMAP's log in an error
// With more, `auto` takes the global mapper. The incremental one is more robust, and its time grows
// faster than the number of photos.
constexpr std::size_t kIncrementalPhotos = 500;

struct Stage {
  ColmapStage stage;
  const char* name;      // in reconstruct.json
  const char* headline;  // while it runs
};
constexpr Stage kStages[] = {{ColmapStage::features, "features", "finding features"},
                             {ColmapStage::matches, "matches", "matching photos"},
                             {ColmapStage::model, "model", "placing cameras"}};

std::set<std::string> stage_names() {
  std::set<std::string> names;
  for (const Stage& stage : kStages) names.insert(stage.name);
  return names;
}

[[noreturn]] void fail_in(const Stage& stage, const ColmapPlan& plan, const ProcessEnd& end) {
  const std::string log = plan.files.log().string();
  if (stage.stage == ColmapStage::model && read_colmap_log(plan.files.log()).no_model)
    throw Error(fmt::format(
        "COLMAP could not place the cameras: no two photos share enough detail from places far "
        "enough apart; take more photos, each with two thirds of the one before in it{}. The "
        "output of COLMAP is in {}",
        plan.matching == Matching::exhaustive ? ""
                                              : ", or try " + plan.flag("matching", "exhaustive"),
        log));
  throw Error(fmt::format(
      "COLMAP failed while {} ({}); the same command continues from here. The end of {}:\n{}",
      stage.headline,
      end.signal ? fmt::format("signal {}: {}", end.signal, strsignal(end.signal))
                 : fmt::format("exit code {}", end.exit_code),
      log, last_lines(plan.files.log(), kLinesShown)));
}

// `before` photos of the stage are done by earlier commands.
ProcessEnd end_of(const Stage& stage, const ColmapCommand& command, const ColmapPlan& plan,
                  const ColmapProgress& progress, std::int64_t before = 0) {
  const auto photos =
      std::int64_t(plan.photos.size()) * (plan.has_panoramas() ? kPanoramaViews : 1);
  if (before == 0) {
    progress(stage.stage, 0, photos);
    log_info("{}: colmap {}", stage.headline, command.arguments()[1]);
  }
  std::ofstream(plan.files.log(), std::ios::app)
      << "\n## " << fmt::format("{}", fmt::join(command.arguments(), " ")) << "\n"
      << "## colmap " << command.arguments()[1] << "\n";
  try {
    return run_process(command.arguments(), plan.files.log(), [&](std::string_view line) {
      const auto count = colmap_count(line);
      if (!count) return;
      const bool counts_photos = count->total == 0 || stage.stage == ColmapStage::features;
      progress(stage.stage, before + count->done, counts_photos ? photos : count->total);
    });
  } catch (const Error& error) {
    if (error.code() != ExitCode::interrupted) throw;
    throw Error(fmt::format("{}; complete parts stay in {}, and the same command continues there",
                            error.what(), plan.files.root.string()),
                ExitCode::interrupted);
  }
}

void run_stage(const Stage& stage, const ColmapCommand& command, const ColmapPlan& plan,
               const ColmapProgress& progress, std::int64_t before = 0) {
  const ProcessEnd end = end_of(stage, command, plan, progress, before);
  if (!end.good()) fail_in(stage, plan, end);
}

// CUDA may be there without a GPU, or with one that has too little memory.
template <class MakeCommand>
void run_on_gpu_or_cpu(const Stage& stage, const MakeCommand& command, ColmapPlan& plan,
                       const ColmapProgress& progress, std::int64_t before = 0) {
  if (plan.use_gpu) {
    if (end_of(stage, command(plan), plan, progress, before).good()) return;
    log_warning(
        "COLMAP failed on the GPU while {}, and goes on without it; {} says why, and "
        "--set reconstruct.use_gpu=false does not try it",
        stage.headline, plan.files.log().string());
    plan.use_gpu = false;
  }
  run_stage(stage, command(plan), plan, progress, before);
}

// The mapper's models become sparse/0, sparse/1, ..., the one with most photos first.
void keep_models(const SceneFiles& files) {
  std::vector<std::pair<std::size_t, fs::path>> models;
  for (const fs::path& folder : colmap_models_in(files.attempt()))
    models.emplace_back(read_colmap_model(folder).images.size(), folder);
  std::stable_sort(models.begin(), models.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  if (models.empty() || models[0].first < kFewestPhotos)
    throw Error(fmt::format(
        "COLMAP placed only {} photo(s), but a scene needs at least {}; take more photos, each of "
        "which shows two thirds of the one before. The output of COLMAP is in {}",
        models.empty() ? 0 : models[0].first, kFewestPhotos, files.log().string()));
  fs::remove_all(files.new_sparse());
  fs::create_directories(files.new_sparse());
  for (std::size_t i = 0; i < models.size(); ++i)
    fs::rename(models[i].second, files.new_sparse() / fmt::format("{}", i));
}

// Models of views become those of panoramas.
void make_panorama_models(const Stage& stage, const ColmapPlan& plan,
                          const ColmapProgress& progress) {
  const bool is_adjusted =
      !has_command(plan, "rig_configurator") && has_command(plan, "rig_bundle_adjuster");
  for (const fs::path& folder : colmap_models_in(plan.files.attempt())) {
    fs::path best = folder;
    if (is_adjusted) {
      write_rig_of_views(plan.files.rig(), read_colmap_model(folder));
      best = plan.files.work / "adjusted";
      fs::create_directories(best);
      run_stage(stage, rig_adjustment_command(plan, folder, best), plan, progress, 1);
    }
    const ColmapModel model = panorama_model(plan, read_colmap_model(best, Tracks::read));
    fs::remove_all(best);
    fs::remove_all(folder);
    write_colmap_model(folder, model);
  }
}

void empty_attempt(const SceneFiles& files) {
  fs::remove_all(files.attempt());  // of an earlier command
  fs::create_directories(files.attempt());
}

bool is_mapped_globally(const ColmapPlan& plan) {
  if (plan.poses || plan.mapper == Mapper::incremental) return false;
  return plan.mapper == Mapper::global ||
         (plan.photos.size() > kIncrementalPhotos && has_command(plan, kGlobalMapper));
}

// Whether it placed half of the photos or more.
bool map_globally(const Stage& stage, const ColmapPlan& plan, const ColmapProgress& progress) {
  const fs::path database = plan.files.global_database();
  fs::copy_file(plan.files.database(), database, fs::copy_options::overwrite_existing);
  if (!plan.has_panoramas() && has_command(plan, "view_graph_calibrator"))
    end_of(stage, calibration_command(plan), plan, progress);  // without it, the result is worse
  const bool is_good = end_of(stage, global_model_command(plan), plan, progress).good();
  fs::remove(database);
  std::size_t placed = 0;
  if (is_good)
    for (const fs::path& model : colmap_models_in(plan.files.attempt()))
      placed = std::max(placed, read_colmap_model(model).images.size());
  const auto photos = plan.photos.size() * (plan.has_panoramas() ? kPanoramaViews : 1);
  if (2 * placed >= photos) return true;
  log_warning("the global mapper {}; the incremental one places the cameras instead",
              is_good ? fmt::format("placed {} of {} photos", placed, photos) : "failed");
  empty_attempt(plan.files);
  return false;
}

void make_model(const Stage& stage, const ColmapPlan& plan, SceneFolder& folder,
                const ColmapProgress& progress) {
  empty_attempt(plan.files);
  if (plan.poses) {
    fs::create_directories(plan.files.attempt() / "0");  // point_triangulator does not
    write_colmap_model(plan.files.known(), known_model(plan));
  }
  if (!is_mapped_globally(plan) || !map_globally(stage, plan, progress))
    run_stage(stage, model_command(plan), plan, progress);
  if (plan.has_panoramas()) make_panorama_models(stage, plan, progress);
  keep_models(plan.files);
  folder.finish(stage.name);
}

// COLMAP gives one camera to all photos of a call, so each group has a call.
void find_features(const Stage& stage, ColmapPlan& plan, const ColmapProgress& progress) {
  const auto extract = [&](const std::vector<PhotoFile>& photos, std::int64_t before) {
    run_on_gpu_or_cpu(
        stage, [&](const ColmapPlan& now) { return feature_command(now, photos); }, plan, progress,
        before);
  };
  if (plan.has_panoramas()) {
    extract(panorama_views(plan), 0);
    if (!has_command(plan, "rig_configurator")) return;
    write_rig_of_views(plan.files.rig());
    return run_stage(stage, rig_command(plan), plan, progress, 1);
  }
  std::int64_t before = 0;
  for (const std::vector<PhotoFile>& photos : camera_groups(plan)) {
    extract(photos, before);
    before += std::int64_t(photos.size());
  }
}

void match_photos(const Stage& stage, ColmapPlan& plan, const ColmapProgress& progress) {
  if (plan.matching == Matching::retrieval)
    run_stage(stage, vocabulary_command(plan), plan, progress);
  run_on_gpu_or_cpu(stage, match_command, plan, progress);
}

void run_stages(ColmapPlan& plan, SceneFolder& folder, const ColmapProgress& progress) {
  for (const Stage& stage : kStages) {
    if (folder.has(stage.name)) {
      log_info("{}: done before", stage.headline);
      continue;
    }
    switch (stage.stage) {
      case ColmapStage::frames:
      case ColmapStage::copies: break;  // taken above
      case ColmapStage::features: find_features(stage, plan, progress); break;
      case ColmapStage::matches: match_photos(stage, plan, progress); break;
      case ColmapStage::model: make_model(stage, plan, folder, progress); continue;
    }
    folder.complete(stage.name);
  }
}

std::string text_of_cameras(const ColmapPlan& plan) {
  if (plan.poses) return "with known cameras";
  if (plan.has_panoramas())
    return fmt::format("panoramas of 360 degrees as {} views each", kPanoramaViews);
  if (!plan.single_camera) return fmt::format("a {} camera each", plan.camera_model);
  const std::size_t count = camera_groups(plan).size();
  return count == 1 ? fmt::format("one {} camera", plan.camera_model)
                    : fmt::format("{} {} cameras, one for each size", count, plan.camera_model);
}

}  // namespace

void check_reconstruction(const ColmapJob& job) { plan_of(job); }

Reconstruction run_colmap(const ColmapJob& job, const ColmapProgress& progress) {
  ColmapPlan plan = plan_of(job);
  if (const auto foreign = job.poses ? std::nullopt : find_foreign_scene(job.photos))
    log_warning(
        "{} holds camera poses of {}, which are not used: COLMAP places the photos anew; "
        "`gemsplat train {}` uses them",
        foreign->file.string(), foreign->program, job.photos.string());
  if (const auto foreign = job.poses ? std::nullopt : find_foreign_cameras(job.photos))
    log_warning(
        "{} holds camera poses of {}, which are not used: COLMAP places the photos anew; to "
        "keep them, {}",
        foreign->file.string(), foreign->program, foreign->way);
  OutputLock lock = OutputLock::of_folder(job.scene);
  const std::unique_ptr<SceneFolder> folder = prepare_folder(plan, job, stage_names(), lock);
  if (!folder->has("model")) plan.files.work = folder->work();
  if (!plan.videos.empty())
    take_frames_of_videos(plan, *folder, progress);
  else if (!folder->has("model"))
    take_photos(plan, *folder, progress);
  if (plan.has_panoramas() && !folder->has("model")) cut_panoramas(plan, progress);
  plan.use_gpu = plan.use_gpu && !folder->has("matches") && has_cuda(plan);
  log_info("{} photos, {}, {} matching{}", plan.photos.size(), text_of_cameras(plan),
           word_of(plan.matching), plan.use_gpu ? " on the GPU" : "");
  run_stages(plan, *folder, progress);
  return verdict_of(plan);
}

}  // namespace gs
