// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/colmap_commands.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>

#include "data_loaders/reconstruct/colmap_log.h"
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

std::string text(bool value) { return value ? "1" : "0"; }
std::string thread_text(const ColmapPlan& plan) {
  return fmt::format("{}", plan.threads ? plan.threads : -1);
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
  command.add("--image_path", plan.files.photos().string());
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

ColmapCommand match_command(const ColmapPlan& plan) {
  // Small blocks make COLMAP report its progress more often; they change nothing else.
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
  ColmapCommand command(plan.program, "mapper");
  command.add("--database_path", plan.files.database().string());
  command.add("--image_path", plan.files.photos().string());
  command.add("--output_path", plan.files.attempt().string());
  command.add_known({"--Mapper.num_threads"}, thread_text(plan));
  return command;
}

}  // namespace gs
