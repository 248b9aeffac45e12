// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/run_colmap.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/reconstruct/colmap_log.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "gs_core/io/atomic_file.h"
#include "gs_core/io/byte_reader.h"
#include "gs_core/io/fnv1a.h"
#include "gs_core/io/move_aside.h"
#include "gs_core/io/subprocess.h"
#include "gs_core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kExhaustivePhotos = 200;  // with more, `auto` matches neighbors by name only
constexpr std::size_t kFewestPhotos = 3;        // that a model to train on may have
constexpr int kFewFeatures = 200;               // in a photo: hardly enough to match it
constexpr int kNeededPoints = 30;  // that a photo must see to be placed; COLMAP's abs_pose_min_num_inliers
constexpr std::size_t kLinesShown = 8;     // of COLMAP's log in an error
constexpr std::size_t kMissingShown = 20;  // names in the verdict

struct Stage {
  ColmapStage stage;
  const char* name;      // in reconstruct.json
  const char* headline;  // while it runs
};
constexpr Stage kStages[] = {{ColmapStage::features, "features", "finding features"},
                             {ColmapStage::matches, "matches", "matching photos"},
                             {ColmapStage::model, "model", "placing cameras"}};

/// Paths inside the scene's folder.
struct SceneFiles {
  fs::path root;
  fs::path images() const { return root / "images"; }
  fs::path sparse() const { return root / "sparse"; }
  fs::path attempt() const { return root / "mapping"; }  // the mapper's models, until they are complete
  fs::path database() const { return root / "database.db"; }
  fs::path log() const { return root / "colmap.log"; }
  fs::path state() const { return root / "reconstruct.json"; }
};

/// A job with all that is decided before the first stage.
struct Plan {
  SceneFiles files;
  std::vector<fs::path> videos;   // then the photos are their frames, once these are there
  std::vector<PhotoFile> photos;
  bool photos_in_place = false;  // they are the scene's images/ already
  std::string program, camera_model;
  Matching matching = Matching::automatic;
  bool single_camera = false, use_gpu = false;
  int max_features = 0, frames = 0, threads = 0;
  SingleCamera single_camera_setting = SingleCamera::automatic;
};

/// reconstruct.json: for which photos and settings which stages are complete.
struct State {
  std::string made_of;
  std::set<std::string> complete;
};

// ---- the plan

std::string found_program(const std::string& name) {
  const auto program = find_program(name);
  if (!program)
    throw Error(fmt::format(
        "cannot find the program {}, which finds where photos were taken; install it (Debian, "
        "Ubuntu: apt install colmap) or name it with --colmap PATH",
        name));
  return program->string();
}

bool same_size(const std::vector<PhotoFile>& photos) {
  return std::all_of(photos.begin(), photos.end(), [&](const PhotoFile& photo) {
    return photo.size.width == photos[0].size.width && photo.size.height == photos[0].size.height;
  });
}

bool is_within(const fs::path& inner, const fs::path& outer) {
  const fs::path relative =
      fs::weakly_canonical(inner).lexically_relative(fs::weakly_canonical(outer));
  return !relative.empty() && *relative.begin() != "..";
}

// What photos and settings decide, once the photos are there.
void complete_plan(Plan& plan, const fs::path& source) {
  if (plan.photos.size() < kFewestPhotos)
    throw Error(
        fmt::format("{} has {} photo(s); a scene needs at least {}, and 30 or more to look well",
                    source.string(), plan.photos.size(), kFewestPhotos));
  if (plan.matching == Matching::automatic)
    plan.matching = plan.videos.empty() && plan.photos.size() <= kExhaustivePhotos
                        ? Matching::exhaustive
                        : Matching::sequential;
  plan.single_camera = plan.single_camera_setting == SingleCamera::automatic
                           ? same_size(plan.photos)
                           : plan.single_camera_setting == SingleCamera::yes;
}

Plan plan_of(const ColmapJob& job) {
  const ReconstructConfig& settings = job.settings;
  Plan plan;
  plan.files.root = job.scene;
  plan.matching = settings.matching;
  plan.single_camera_setting = settings.single_camera;
  plan.camera_model = settings.camera_model;
  plan.max_features = settings.max_features;
  plan.frames = settings.frames;
  plan.use_gpu = settings.use_gpu;
  plan.threads = job.threads;
  plan.videos = find_videos(job.photos);
  plan.program = found_program(settings.colmap);
  const bool same_folder = fs::weakly_canonical(job.photos) == fs::weakly_canonical(job.scene);
  if (!plan.videos.empty()) {
    if (same_folder)
      throw UsageError("the videos and the scene are in the same folder, " + job.photos.string() +
                       "; name another for the scene with -o");
    return plan;
  }
  if (same_folder && !fs::is_directory(plan.files.images()))
    throw UsageError("the photos and the scene are the same folder, " + job.photos.string() +
                     "; name another for the scene with -o, or put the photos into its images/");
  const fs::path photos = same_folder ? plan.files.images() : job.photos;
  plan.photos = find_photos(photos, job.scene);
  plan.photos_in_place = is_within(photos, plan.files.images());
  if (plan.photos_in_place && !is_within(plan.files.images(), photos))
    throw UsageError(fmt::format("{} lies inside the images of {}; choose another scene with -o",
                                 photos.string(), job.scene.string()));
  complete_plan(plan, job.photos);
  return plan;
}

/// Says by which photos and settings a result was made: another text, another result.
std::string made_of(const Plan& plan) {
  Fnv1a hash;
  for (const fs::path& video : plan.videos)
    hash.add(fmt::format("{}\n{}\n", video.filename().string(), fs::file_size(video)));
  if (!plan.videos.empty())
    return fmt::format("{} frames of {} videos {:016x}, {}, {} camera(s), {} matching, {} features",
                       plan.frames, plan.videos.size(), hash.value(), plan.camera_model,
                       word_of(plan.single_camera_setting), word_of(plan.matching),
                       plan.max_features);
  for (const PhotoFile& photo : plan.photos)
    hash.add(fmt::format("{}\n{}\n", photo.name, fs::file_size(photo.path)));
  return fmt::format("{} photos {:016x}, {}, {} camera(s), {} matching, {} features",
                     plan.photos.size(), hash.value(), plan.camera_model,
                     plan.single_camera ? "one" : "own", word_of(plan.matching), plan.max_features);
}

// ---- the state

State read_state(const SceneFiles& files) {
  State state;
  std::ifstream stream(files.state());
  try {
    const auto json = nlohmann::json::parse(stream);
    state.made_of = json.at("made_of").get<std::string>();
    state.complete = json.at("complete").get<std::set<std::string>>();
  } catch (const nlohmann::json::exception&) {  // missing or damaged: nothing is complete
    return {};
  }
  return state;
}

void write_state(const SceneFiles& files, const State& state) {
  nlohmann::ordered_json json;
  json["made_of"] = state.made_of;
  json["complete"] = state.complete;
  AtomicFile file(files.state());
  file.write(json.dump(2) + "\n");
  file.commit();
}

bool is_finished(const State& state) {
  return std::all_of(std::begin(kStages), std::end(kStages),
                     [&](const Stage& stage) { return state.complete.contains(stage.name); });
}

// ---- the folder

// Whether the folder holds a result of anyone's that we would write over.
bool holds_other_work(const Plan& plan) {
  const SceneFiles& files = plan.files;
  return fs::exists(files.sparse()) || fs::exists(files.database()) ||
         is_colmap_model(files.root) || (fs::exists(files.images()) && !plan.photos_in_place);
}

/// Leaves the folder ready for the stages that the returned state lacks.
State prepare_folder(const Plan& plan, const ColmapJob& job) {
  const SceneFiles& files = plan.files;
  State state = read_state(files), fresh{made_of(plan), {}};
  const bool ours = !state.made_of.empty(), same = state.made_of == fresh.made_of;
  if (job.force && (ours || holds_other_work(plan))) {
    if (is_within(job.photos, job.scene))
      throw UsageError(
          fmt::format("cannot move {} away, as --force asks: the photos lie in it; choose another "
                      "scene with -o",
                      job.scene.string()));
    log_warning("what was in {} was moved to {}", job.scene.string(),
                move_aside(job.scene).string());
    return fresh;
  }
  if (ours && same) return state;
  if (ours && !is_finished(state)) {
    log_warning("photos or settings are not those of the unfinished scene in {}: starting over",
                job.scene.string());
    for (const fs::path& path : {files.database(), files.log(), files.sparse(), files.attempt()})
      fs::remove_all(path);
    if (!plan.photos_in_place) fs::remove_all(files.images());
    return fresh;
  }
  if (ours || holds_other_work(plan))
    throw UsageError(fmt::format(
        "the folder {} holds a scene already{}; choose another with -o, or give --force to move it "
        "to {}.bak-N first",
        job.scene.string(), ours ? ", of other photos or settings" : "", job.scene.string()));
  return fresh;
}

// A hard link where the file system has them, else a copy; the photo itself stays as it is.
void take_photos(const Plan& plan) {
  if (plan.photos_in_place) return;
  for (const PhotoFile& photo : plan.photos) {
    const fs::path target = plan.files.images() / photo.name;
    if (fs::exists(target)) continue;
    std::error_code error;
    fs::create_directories(target.parent_path(), error);
    const fs::path source = fs::canonical(photo.path);
    fs::create_hard_link(source, target, error);
    if (error) fs::copy_file(source, target, error);
    if (error)
      throw Error(
          fmt::format("cannot copy {} to {}: {}; free some space or choose another folder "
                      "with -o",
                      source.string(), target.string(), error.message()));
  }
}

// ---- frames of videos

// The share of `frames` that a video of so many of all frames gets.
std::int64_t share_of(std::int64_t own, std::int64_t all, int frames) {
  return std::max<std::int64_t>(1, (own * frames + all / 2) / all);
}

// What the frames of each video are called: its name without the ending, or with it where two would be called alike.
std::vector<std::string> stems_of(const std::vector<fs::path>& videos) {
  std::map<std::string, int> counts;
  for (const fs::path& video : videos) ++counts[video.stem().string()];
  std::vector<std::string> stems;
  for (const fs::path& video : videos)
    stems.push_back(counts[video.stem().string()] == 1 ? video.stem().string()
                                                       : video.filename().string());
  return stems;
}

// Fills images/ video by video, each once, and completes the plan.
void take_photos_from_videos(Plan& plan, State& state, const ColmapProgress& progress) {
  const std::vector<std::string> stems = stems_of(plan.videos);
  const auto name_of = [&](std::size_t i) { return "frames of " + stems[i]; };
  std::vector<std::int64_t> counts;
  std::int64_t all = 0, before = 0;
  for (const fs::path& video : plan.videos) all += counts.emplace_back(count_frames(video));
  for (std::size_t i = 0; i < plan.videos.size(); before += counts[i++]) {
    if (state.complete.contains(name_of(i))) continue;
    progress(ColmapStage::frames, before, all);
    const std::int64_t wanted = share_of(counts[i], all, plan.frames);
    log_info("the sharpest {} of {} frames of {}", std::min(wanted, counts[i]), counts[i],
             plan.videos[i].string());
    take_frames(plan.videos[i], counts[i], wanted, plan.files.images(), stems[i],
                [&](std::int64_t done) { progress(ColmapStage::frames, before + done, all); });
    state.complete.insert(name_of(i));
    write_state(plan.files, state);
  }
  plan.photos = find_photos(plan.files.images(), {});
  complete_plan(plan, plan.videos[0].parent_path());
}

void write_photo_list(const Plan& plan, const fs::path& file) {
  AtomicFile list(file);
  for (const PhotoFile& photo : plan.photos) list.write(photo.name + "\n");
  list.commit();
}

// ---- COLMAP's commands

/// One command line of COLMAP. Options changed their names over its versions: the command's own help says
/// which it knows.
class ColmapCommand {
 public:
  ColmapCommand(const std::string& program, const std::string& command)
      : arguments_{program, command} {
    run_process({program, command, "-h"}, {}, [this](std::string_view line) {
      if (const std::size_t at = line.find("--"); at != line.npos)
        known_.insert(std::string(line.substr(at, line.find_first_of(" =\r", at) - at)));
    });
  }

  void add(const std::string& option, const std::string& value) {
    arguments_.insert(arguments_.end(), {option, value});
  }
  /// The first of the names that the command knows; nothing if it knows none.
  void add_known(std::initializer_list<const char*> options, const std::string& value) {
    const auto name = std::find_if(options.begin(), options.end(),
                                   [&](const char* option) { return known_.contains(option); });
    if (name != options.end()) add(*name, value);
  }
  const std::vector<std::string>& arguments() const { return arguments_; }

 private:
  std::vector<std::string> arguments_;
  std::set<std::string> known_;
};

std::string text(bool value) { return value ? "1" : "0"; }
std::string thread_text(const Plan& plan) {
  return fmt::format("{}", plan.threads ? plan.threads : -1);
}

ColmapCommand feature_command(const Plan& plan) {
  ColmapCommand command(plan.program, "feature_extractor");
  const fs::path list = plan.files.root / "photos.txt";
  write_photo_list(plan, list);
  command.add("--database_path", plan.files.database().string());
  command.add("--image_path", plan.files.images().string());
  command.add("--image_list_path", list.string());
  command.add("--ImageReader.camera_model", plan.camera_model);
  command.add("--ImageReader.single_camera", text(plan.single_camera));
  command.add_known({"--SiftExtraction.max_num_features"}, fmt::format("{}", plan.max_features));
  command.add_known({"--FeatureExtraction.use_gpu", "--SiftExtraction.use_gpu"},
                    text(plan.use_gpu));
  command.add_known({"--FeatureExtraction.num_threads", "--SiftExtraction.num_threads"},
                    thread_text(plan));
  return command;
}

ColmapCommand match_command(const Plan& plan) {
  // Small blocks, which change nothing but how often COLMAP says where it is.
  const std::size_t block = std::clamp<std::size_t>(plan.photos.size() / 8, 5, 50);
  ColmapCommand command(plan.program, fmt::format("{}_matcher", word_of(plan.matching)));
  command.add("--database_path", plan.files.database().string());
  if (plan.matching == Matching::exhaustive)
    command.add_known({"--ExhaustiveMatching.block_size", "--ExhaustivePairing.block_size"},
                      fmt::format("{}", block));
  command.add_known({"--FeatureMatching.use_gpu", "--SiftMatching.use_gpu"}, text(plan.use_gpu));
  command.add_known({"--FeatureMatching.num_threads", "--SiftMatching.num_threads"},
                    thread_text(plan));
  return command;
}

ColmapCommand model_command(const Plan& plan) {
  ColmapCommand command(plan.program, "mapper");
  command.add("--database_path", plan.files.database().string());
  command.add("--image_path", plan.files.images().string());
  command.add("--output_path", plan.files.attempt().string());
  command.add_known({"--Mapper.num_threads"}, thread_text(plan));
  return command;
}

[[noreturn]] void fail_in(const Stage& stage, const Plan& plan, const ProcessEnd& end) {
  const std::string log = plan.files.log().string();
  if (stage.stage == ColmapStage::model && read_colmap_log(plan.files.log()).no_model)
    throw Error(fmt::format(
        "COLMAP could not place the cameras: no two photos share enough detail from places far "
        "enough apart; take more photos, each with two thirds of the one before in it{}. All that "
        "COLMAP said is in {}",
        plan.matching == Matching::sequential ? ", or try --matching exhaustive" : "", log));
  throw Error(fmt::format(
      "COLMAP failed while {} ({}). The end of {}:\n{}\nThe same command continues from here",
      stage.headline,
      end.signal ? fmt::format("signal {}: {}", end.signal, strsignal(end.signal))
                 : fmt::format("exit code {}", end.exit_code),
      log, last_lines(plan.files.log(), kLinesShown)));
}

void run_stage(const Stage& stage, const ColmapCommand& command, const Plan& plan,
               const ColmapProgress& progress) {
  const auto photos = std::int64_t(plan.photos.size());
  progress(stage.stage, 0, photos);
  log_info("{}: colmap {}", stage.headline, command.arguments()[1]);
  std::ofstream(plan.files.log(), std::ios::app)
      << "\n## " << fmt::format("{}", fmt::join(command.arguments(), " ")) << "\n"
      << "## colmap " << command.arguments()[1] << "\n";
  ProcessEnd end;
  try {
    end = run_process(command.arguments(), plan.files.log(), [&](std::string_view line) {
      if (const auto count = colmap_count(line))
        progress(stage.stage, count->done, count->total ? count->total : photos);
    });
  } catch (const Error& error) {
    if (error.code() != ExitCode::interrupted) throw;
    throw Error(
        fmt::format("{}; what is complete stays in {}, and the same command continues there",
                    error.what(), plan.files.root.string()),
        ExitCode::interrupted);
  }
  if (!end.good()) fail_in(stage, plan, end);
}

// ---- the models

double mean_error_of(const ColmapModel& model) {
  double sum = 0;
  for (const ColmapPoint& point : model.points) sum += point.error;
  return model.points.empty() ? 0 : sum / double(model.points.size());
}

// The mapper's models become sparse/0, sparse/1, ..., the one with most photos first.
void keep_models(const SceneFiles& files) {
  std::vector<std::pair<std::size_t, fs::path>> models;
  for (const fs::path& folder : colmap_models_in(files.attempt()))
    models.emplace_back(read_colmap_model(folder).images.size(), folder);
  std::stable_sort(models.begin(), models.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  if (models.empty() || models[0].first < kFewestPhotos)
    throw Error(
        fmt::format("COLMAP placed only {} photo(s), and a scene needs at least {}; take more "
                    "photos, each with "
                    "two thirds of the one before in it. All that COLMAP said is in {}",
                    models.empty() ? 0 : models[0].first, kFewestPhotos, files.log().string()));
  fs::remove_all(files.sparse());
  fs::create_directories(files.sparse());
  for (std::size_t i = 0; i < models.size(); ++i)
    fs::rename(models[i].second, files.sparse() / fmt::format("{}", i));
  fs::remove_all(files.attempt());
}

void make_model(const Stage& stage, const Plan& plan, const ColmapProgress& progress) {
  fs::remove_all(plan.files.attempt());
  fs::create_directories(plan.files.attempt());
  run_stage(stage, model_command(plan), plan, progress);
  keep_models(plan.files);
}

// ---- the verdict

/// Why photos may be missing, from the log and the other models.
class Reasons {
 public:
  Reasons(const SceneFiles& files, const ColmapModel& largest)
      : log_(read_colmap_log(files.log())) {
    for (std::size_t i = 0; i < log_.photos.size(); ++i)
      ids_[log_.photos[i].name] = std::uint32_t(i + 1);
    for (const ColmapImage& image : largest.images)
      if (const auto id = ids_.find(image.name); id != ids_.end() && id->second != image.id)
        log_.seen_points.clear();  // ids are not what they should be
    for (const fs::path& folder : colmap_models_in(files.sparse()))
      if (folder != largest.folder)
        for (const ColmapImage& image : read_colmap_model(folder).images)
          other_models_.emplace(image.name, "sparse/" + folder.filename().string());
  }

  std::string of(const std::string& name) const {
    if (const auto other = other_models_.find(name); other != other_models_.end())
      return fmt::format("it is in another model, {}, that shares too little with the largest",
                         other->second);
    const auto id = ids_.find(name);
    if (id == ids_.end()) return "COLMAP found no features in it, or could not read it";
    const int features = log_.photos[id->second - 1].features;
    if (features < kFewFeatures)
      return fmt::format("too few features ({}): blurred, dark or without texture", features);
    const auto seen = log_.seen_points.find(id->second);
    if (seen == log_.seen_points.end())
      return fmt::format("too few matches with the photos placed ({} features)", features);
    return fmt::format("{} of the model's points seen, {}", seen->second,
                       seen->second < kNeededPoints
                           ? fmt::format("{} are needed: too little overlap", kNeededPoints)
                           : "but no pose fits them: repeated patterns, or things that moved");
  }

 private:
  ColmapLog log_;
  std::map<std::string, std::uint32_t> ids_;
  std::map<std::string, std::string> other_models_;
};

Reconstruction verdict_of(const Plan& plan) {
  const ColmapModel model = read_colmap_model(plan.files.sparse() / "0");
  const Reasons reasons(plan.files, model);
  std::set<std::string> registered;
  for (const ColmapImage& image : model.images) registered.insert(image.name);
  Reconstruction result;
  result.scene = plan.files.root;
  result.photos = plan.photos.size();
  result.registered = model.images.size();
  result.points = model.points.size();
  result.models = colmap_models_in(plan.files.sparse()).size();
  result.mean_error = mean_error_of(model);
  for (const PhotoFile& photo : plan.photos)
    if (!registered.contains(photo.name))
      result.missing.push_back({photo.name, reasons.of(photo.name)});
  return result;
}

}  // namespace

Reconstruction run_colmap(const ColmapJob& job, const ColmapProgress& progress) {
  Plan plan = plan_of(job);
  State state = prepare_folder(plan, job);
  write_state(plan.files, state);
  if (plan.videos.empty())
    take_photos(plan);
  else
    take_photos_from_videos(plan, state, progress);
  log_info("{} photos, {}, {} matching", plan.photos.size(),
           plan.single_camera ? "one " + plan.camera_model + " camera"
                              : "a " + plan.camera_model + " camera each",
           word_of(plan.matching));
  for (const Stage& stage : kStages) {
    if (state.complete.contains(stage.name)) {
      log_info("{}: done before", stage.headline);
      continue;
    }
    switch (stage.stage) {
      case ColmapStage::frames: break;  // none of COLMAP's
      case ColmapStage::features: run_stage(stage, feature_command(plan), plan, progress); break;
      case ColmapStage::matches: run_stage(stage, match_command(plan), plan, progress); break;
      case ColmapStage::model: make_model(stage, plan, progress); break;
    }
    state.complete.insert(stage.name);
    write_state(plan.files, state);
  }
  return verdict_of(plan);
}

std::string describe(const Reconstruction& result) {
  std::string lines =
      fmt::format("{} of {} photos placed, {} points, mean reprojection error {:.2f} pixels\n",
                  result.registered, result.photos, result.points, result.mean_error);
  if (result.models > 1)
    lines +=
        fmt::format("{} models that do not fit together; the largest is sparse/0\n", result.models);
  const std::size_t shown = std::min(result.missing.size(), kMissingShown);
  for (std::size_t i = 0; i < shown; ++i)
    lines += fmt::format("missing: {}: {}\n", result.missing[i].name, result.missing[i].reason);
  if (shown < result.missing.size())
    lines += fmt::format("missing: {} more\n", result.missing.size() - shown);
  return lines;
}

}  // namespace gs
