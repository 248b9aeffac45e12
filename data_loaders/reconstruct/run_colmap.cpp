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
        plan.matching == Matching::sequential ? ", or try " + plan.flag("matching", "exhaustive")
                                              : "",
        log));
  throw Error(fmt::format(
      "COLMAP failed while {} ({}); the same command continues from here. The end of {}:\n{}",
      stage.headline,
      end.signal ? fmt::format("signal {}: {}", end.signal, strsignal(end.signal))
                 : fmt::format("exit code {}", end.exit_code),
      log, last_lines(plan.files.log(), kLinesShown)));
}

// `before` photos of the stage are done by earlier commands.
void run_stage(const Stage& stage, const ColmapCommand& command, const ColmapPlan& plan,
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
  ProcessEnd end;
  try {
    end = run_process(command.arguments(), plan.files.log(), [&](std::string_view line) {
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
  if (!end.good()) fail_in(stage, plan, end);
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

void make_model(const Stage& stage, const ColmapPlan& plan, SceneFolder& folder,
                const ColmapProgress& progress) {
  fs::remove_all(plan.files.attempt());  // of an earlier command
  fs::create_directories(plan.files.attempt());
  if (plan.poses) {
    fs::create_directories(plan.files.attempt() / "0");  // point_triangulator does not
    write_colmap_model(plan.files.known(), known_model(plan));
  }
  run_stage(stage, model_command(plan), plan, progress);
  if (plan.has_panoramas()) make_panorama_models(stage, plan, progress);
  keep_models(plan.files);
  folder.finish(stage.name);
}

// COLMAP gives one camera to all photos of a call, so each group has a call.
void find_features(const Stage& stage, const ColmapPlan& plan, const ColmapProgress& progress) {
  if (plan.has_panoramas()) {
    run_stage(stage, feature_command(plan, panorama_views(plan)), plan, progress);
    if (!has_command(plan, "rig_configurator")) return;
    write_rig_of_views(plan.files.rig());
    return run_stage(stage, rig_command(plan), plan, progress, 1);
  }
  std::int64_t before = 0;
  for (const std::vector<PhotoFile>& photos : camera_groups(plan)) {
    run_stage(stage, feature_command(plan, photos), plan, progress, before);
    before += std::int64_t(photos.size());
  }
}

void run_stages(const ColmapPlan& plan, SceneFolder& folder, const ColmapProgress& progress) {
  for (const Stage& stage : kStages) {
    if (folder.has(stage.name)) {
      log_info("{}: done before", stage.headline);
      continue;
    }
    switch (stage.stage) {
      case ColmapStage::frames:
      case ColmapStage::copies: break;  // taken above
      case ColmapStage::features: find_features(stage, plan, progress); break;
      case ColmapStage::matches: run_stage(stage, match_command(plan), plan, progress); break;
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
  log_info("{} photos, {}, {} matching", plan.photos.size(), text_of_cameras(plan),
           word_of(plan.matching));
  run_stages(plan, *folder, progress);
  return verdict_of(plan);
}

}  // namespace gs
