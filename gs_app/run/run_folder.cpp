// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/run_folder.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <fstream>
#include <iterator>

#include "data_loaders/cameras/camera_file.h"
#include "data_loaders/cameras/exposure_file.h"
#include "data_loaders/colmap/world_offset.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/formats/ply/ply.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// A Python string literal, as repr() prints it.
std::string python_text(const std::string& text) {
  std::string result = "'";
  for (const char c : text) {
    if (c == '\'' || c == '\\') result += '\\';
    if (static_cast<unsigned char>(c) < 0x20)
      result += fmt::format("\\x{:02x}", c);
    else
      result += c;
  }
  return result + "'";
}

// The reference trainer's arguments, as its readers eval() them.
std::string cfg_args(const Config& config, const fs::path& root) {
  const auto truth = [](bool value) { return value ? "True" : "False"; };
  return fmt::format(
      "Namespace(sh_degree={}, source_path={}, model_path={}, images={}, resolution={}, "
      "white_background={}, data_device={}, eval={})",
      config.model.sh_degree, python_text(config.dataset.source),
      python_text(fs::absolute(root).lexically_normal().string()),
      python_text(config.dataset.images),
      config.dataset.resolution == 0 ? -1 : config.dataset.resolution,  // -1 caps the width there
      truth(config.render.background == Background::white),
      config.train.device == "cpu" ? "'cpu'" : "'cuda'", truth(config.dataset.eval));
}

std::string split_json(const Config& config, const Scene& scene) {
  const auto names = [](const std::vector<View>& views) {
    auto list = Json::array();
    for (const View& view : views) list.push_back(view.name);
    return list;
  };
  Json split;
  split["train"] = names(scene.train_views);
  split["test"] = names(scene.test_views);
  split["rule"] = config.dataset.eval
                      ? fmt::format(
                            "views sorted by name in byte order; the first of every {} is for "
                            "testing; views of one rig frame stay together",
                            config.dataset.test_every)
                      : "all views are for training";
  return file_text(split);
}

}  // namespace

fs::path RunFolder::ply(int step) const {
  return root_ / "point_cloud" / fmt::format("iteration_{}", step) / "point_cloud.ply";
}

fs::path RunFolder::raw_ply(int step) const {
  return ply(step).replace_filename("point_cloud.raw.ply");
}

fs::path RunFolder::pictures(std::string_view split, int step) const {
  return root_ / split / fmt::format("ours_{}", step);
}

bool RunFolder::holds_run() const {
  for (const fs::path& path :
       {root_ / "point_cloud", checkpoints(), cameras(), cfg_args(), config(), input_points(),
        split(), metrics(), profile(), results(), per_view(), comparison(), report(), exposures(),
        photometric(), poses(), refined_model(), world_offset()}) {
    if (fs::exists(path)) return true;
  }
  return false;
}

std::optional<int> RunFolder::newest_step() const {
  std::optional<int> newest;
  for (const fs::path& entry : entries_of(root_ / "point_cloud")) {
    const std::string name = entry.filename().string();
    constexpr std::string_view kPrefix = "iteration_";
    int step = 0;
    if (!name.starts_with(kPrefix)) continue;
    const auto [end, failure] =
        std::from_chars(name.data() + kPrefix.size(), name.data() + name.size(), step);
    if (failure != std::errc() || end != name.data() + name.size()) continue;
    if (fs::exists(ply(step)) && step > newest.value_or(-1)) newest = step;
  }
  return newest;
}

std::vector<fs::path> inputs_of(const Config& config) {
  const DatasetConfig& dataset = config.dataset;
  std::vector<fs::path> inputs = {dataset.source, dataset.photo_list, config.model.start_from};
  if (config.eval.lpips != "none") inputs.push_back(config.eval.lpips);
  for (const std::string& part : {dataset.images, dataset.masks, dataset.depth, dataset.model})
    if (!dataset.source.empty() && !part.empty()) inputs.push_back(fs::path(dataset.source) / part);
  return inputs;
}

void check_is_folder(const RunFolder& folder) {
  if (fs::exists(folder.root()) && !fs::is_directory(folder.root()))
    throw UsageError("the output " + folder.root().string() + " is a file; name a folder with -o");
}

void check_is_free(const RunFolder& folder, bool force, const std::vector<fs::path>& needed) {
  const std::string name = folder.root().string();
  if (folder.holds_run() && !force)
    throw UsageError(
        "the output folder " + name +
        " holds a run already; --resume goes on with it, -o chooses another folder, and --force "
        "moves it to " +
        name + ".bak-N first");
  if (folder.holds_run()) check_may_move(folder.root(), needed);
}

void move_run_aside(const RunFolder& folder, OutputLock& lock,
                    const std::vector<fs::path>& needed) {
  if (!folder.holds_run()) return;
  const fs::path backup = lock.move_folder_aside(needed);
  log_warning("the run in {} was moved to {}", folder.root().string(), backup.string());
}

void write_run_description(const RunFolder& folder, const Config& config, const Scene& scene) {
  write_text(folder.config(), to_toml(config));
  write_text(folder.cfg_args(), cfg_args(config, folder.root()));
  write_text(folder.split(), split_json(config, scene));
  write_cameras_json(folder.cameras(), scene);
  write_point_ply(folder.input_points(), scene.points, scene.world_offset);
  if (scene.world_offset != Vec3d(0.0))
    write_world_offset(folder.world_offset(), scene.world_offset);
  if (scene.exposure) write_exposures(folder.exposures(), scene);
}

std::vector<std::string> split_names(const RunFolder& folder, const std::string& split) {
  constexpr const char* kRemedy = "leave --split out, or give --data SCENE";
  const auto json = read_json_as(folder.split(), kRemedy);
  return take_from_json(folder.split(), kRemedy,
                        [&] { return json.at(split).get<std::vector<std::string>>(); });
}

bool holds_text(const fs::path& path, std::string_view text) {
  std::ifstream file(path, std::ios::binary);
  return file && std::string(std::istreambuf_iterator<char>(file), {}) == text;
}

void write_text(const fs::path& path, std::string_view text) {
  AtomicFile file(path);
  file.write(text);
  file.commit();
}

}  // namespace gs
