// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/colmap_commands.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <functional>
#include <map>

#include "data_loaders/reconstruct/colmap_log.h"
#include "data_loaders/reconstruct/panorama_views.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/processes/subprocess.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

void write_photo_list(const std::vector<PhotoFile>& photos, const fs::path& file) {
  AtomicFile list(file);
  for (const PhotoFile& photo : photos) list.write(photo.name + "\n");
  list.commit();
}

// Of Matching::retrieval. A word needs 10 features or more; newer versions of COLMAP compare each
// feature with each word, so that few words and features keep the vocabulary a matter of seconds.
constexpr int kWords = 4096, kWordFeatures = 64 * kWords;
constexpr std::size_t kWordPhotos = 50;  // whose features are taken, in older versions
constexpr const char* kAlike = "50";     // photos that each is compared with

std::string text(bool value) { return value ? "1" : "0"; }
/// Where the pictures lie that COLMAP sees.
fs::path pictures_of(const ColmapPlan& plan) {
  return plan.has_panoramas() ? plan.files.views() : plan.files.photos();
}
std::string thread_text(const ColmapPlan& plan) {
  return fmt::format("{}", plan.threads ? plan.threads : -1);
}

ColmapCommand mapper_command(const ColmapPlan& plan, const char* name, const std::string& group,
                             const fs::path& database) {
  ColmapCommand command(plan.program, name);
  command.add("--database_path", database.string());
  command.add("--image_path", pictures_of(plan).string());
  command.add("--output_path", plan.files.attempt().string());
  if (plan.has_panoramas())  // the lens and the turns of their views are known
    for (const char* what : {"focal_length", "extra_params", "sensor_from_rig"})
      command.add_known(
          {(group + ".ba_refine_" + what).c_str(), (group + ".refine_" + what).c_str()}, "0");
  command.add_known({(group + ".num_threads").c_str()}, thread_text(plan));
  return command;
}

/// Whether a line of the program's help fits.
bool helps(const ColmapPlan& plan, const std::function<bool(std::string_view)>& fits) {
  bool is_there = false;
  run_process({plan.program, "help"}, {}, [&](std::string_view line) { is_there |= fits(line); });
  return is_there;
}

}  // namespace

ColmapCommand::ColmapCommand(const std::string& program, const std::string& command)
    : arguments_{program, command} {
  run_process({program, command, "-h"}, {}, [this](std::string_view line) {
    if (const std::size_t at = line.find("--"); at != line.npos)
      known_.insert(std::string(line.substr(at, line.find_first_of(" =\r", at) - at)));
  });
}

void ColmapCommand::add(const std::string& option, const std::string& value) {
  arguments_.insert(arguments_.end(), {option, value});
}

void ColmapCommand::add_known(std::initializer_list<const char*> options,
                              const std::string& value) {
  const auto name = std::find_if(options.begin(), options.end(),
                                 [&](const char* option) { return known_.contains(option); });
  if (name != options.end()) add(*name, value);
}

ColmapCommand feature_command(const ColmapPlan& plan, const std::vector<PhotoFile>& photos) {
  ColmapCommand command(plan.program, "feature_extractor");
  const fs::path list = plan.files.photo_list();
  write_photo_list(photos, list);
  command.add("--database_path", plan.files.database().string());
  command.add("--image_path", pictures_of(plan).string());
  command.add("--image_list_path", list.string());
  if (plan.has_panoramas()) {  // views in one folder have one place on the rig
    command.add("--ImageReader.camera_model", "PINHOLE");
    command.add("--ImageReader.camera_params", panorama_view_params(plan));
    command.add("--ImageReader.single_camera_per_folder", "1");
  } else {
    command.add("--ImageReader.camera_model", plan.camera_model);
    command.add("--ImageReader.single_camera", text(plan.single_camera));
  }
  command.add_known({"--SiftExtraction.max_num_features"}, fmt::format("{}", plan.max_features));
  command.add_known({"--FeatureExtraction.use_gpu", "--SiftExtraction.use_gpu"},
                    text(plan.use_gpu));
  command.add_known({"--FeatureExtraction.num_threads", "--SiftExtraction.num_threads"},
                    thread_text(plan));
  return command;
}

ColmapCommand match_command(const ColmapPlan& plan) {
  // Small blocks make COLMAP report its progress more often; they change nothing else.
  const std::size_t block = std::clamp<std::size_t>(plan.photos.size() / 8, 5, 50);
  const bool is_by_words = plan.matching == Matching::retrieval;
  ColmapCommand command(plan.program, is_by_words
                                          ? "vocab_tree_matcher"
                                          : fmt::format("{}_matcher", word_of(plan.matching)));
  command.add("--database_path", plan.files.database().string());
  if (plan.matching == Matching::exhaustive)
    command.add_known({"--ExhaustiveMatching.block_size", "--ExhaustivePairing.block_size"},
                      fmt::format("{}", block));
  if (is_by_words) {
    command.add("--VocabTreeMatching.vocab_tree_path", plan.files.vocabulary().string());
    command.add("--VocabTreeMatching.num_images", kAlike);
  }
  command.add_known({"--FeatureMatching.use_gpu", "--SiftMatching.use_gpu"}, text(plan.use_gpu));
  command.add_known({"--FeatureMatching.num_threads", "--SiftMatching.num_threads"},
                    thread_text(plan));
  return command;
}

ColmapCommand vocabulary_command(const ColmapPlan& plan) {
  ColmapCommand command(plan.program, "vocab_tree_builder");
  command.add("--database_path", plan.files.database().string());
  command.add("--vocab_tree_path", plan.files.vocabulary().string());
  command.add("--num_visual_words", fmt::format("{}", kWords));
  command.add("--num_iterations", "10");
  command.add_known({"--branching"}, "64");  // kWords in two levels
  command.add_known({"--num_rounds"}, "1");
  command.add_known({"--num_threads"}, thread_text(plan));
  command.add_known({"--max_num_descriptors"}, fmt::format("{}", kWordFeatures));
  command.add_known({"--max_num_images"},  // COLMAP ends if there are fewer
                    fmt::format("{}", std::min(plan.photos.size() / 2, kWordPhotos)));
  return command;
}

ColmapModel known_model(const ColmapPlan& plan) {
  ColmapModel known;
  known.cameras = plan.poses->cameras;
  std::map<std::string, std::uint32_t> ids;
  for (const ColmapLog::Photo& photo : read_colmap_log(plan.files.log()).photos)
    ids.emplace(photo.name, std::uint32_t(ids.size() + 1));
  for (const ColmapImage& image : plan.poses->images) {
    const auto id = ids.find(image.name);
    if (id == ids.end()) continue;  // COLMAP could not read it
    ColmapImage posed;
    posed.id = id->second;
    posed.name = image.name;
    posed.camera_id = image.camera_id;
    posed.cam_from_world_rotation = image.cam_from_world_rotation;
    posed.cam_from_world_translation = image.cam_from_world_translation;
    known.images.push_back(std::move(posed));
  }
  return known;
}

ColmapCommand model_command(const ColmapPlan& plan) {
  if (plan.poses) {
    ColmapCommand command(plan.program, "point_triangulator");
    command.add("--database_path", plan.files.database().string());
    command.add("--image_path", plan.files.photos().string());
    command.add("--input_path", plan.files.known().string());
    command.add("--output_path", (plan.files.attempt() / "0").string());
    command.add_known({"--clear_points"}, "1");
    command.add_known({"--Mapper.num_threads"}, thread_text(plan));
    return command;
  }
  return mapper_command(plan, "mapper", "--Mapper", plan.files.database());
}

ColmapCommand calibration_command(const ColmapPlan& plan) {
  ColmapCommand command(plan.program, "view_graph_calibrator");
  command.add("--database_path", plan.files.global_database().string());
  return command;
}

ColmapCommand global_model_command(const ColmapPlan& plan) {
  return mapper_command(plan, kGlobalMapper, "--GlobalMapper", plan.files.global_database());
}

bool has_command(const ColmapPlan& plan, const std::string& command) {
  return helps(plan, [&](std::string_view line) {
    const std::size_t begin = line.find_first_not_of(" \t");
    return begin != line.npos && line.substr(begin).starts_with(command);
  });
}

bool has_cuda(const ColmapPlan& plan) {
  return helps(plan, [](std::string_view line) { return line.find("with CUDA") != line.npos; });
}

ColmapCommand rig_command(const ColmapPlan& plan) {
  ColmapCommand command(plan.program, "rig_configurator");
  command.add("--database_path", plan.files.database().string());
  command.add("--rig_config_path", plan.files.rig().string());
  return command;
}

ColmapCommand rig_adjustment_command(const ColmapPlan& plan, const fs::path& model,
                                     const fs::path& adjusted) {
  ColmapCommand command(plan.program, "rig_bundle_adjuster");
  command.add("--input_path", model.string());
  command.add("--output_path", adjusted.string());
  command.add("--rig_config_path", plan.files.rig().string());
  command.add_known({"--estimate_rig_relative_poses"}, "0");
  command.add_known({"--RigBundleAdjustment.refine_relative_poses"}, "0");
  command.add_known({"--BundleAdjustment.refine_focal_length"}, "0");
  command.add_known({"--BundleAdjustment.refine_extra_params"}, "0");
  return command;
}

}  // namespace gs
