// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/project.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <set>

#include "data_loaders/photos/photo_names.h"
#include "data_loaders/reconstruct/photo_walk.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/photo_list.h"
#include "data_loaders/scene/scene_model.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/formats/formats.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::array kStateWords = {"waiting", "running", "done",
                                    "failed",  "stopped", "interrupted"};
constexpr const char* kRemedy = "restore it from a copy, or move the folder elsewhere";
constexpr int kVersion = 1;
constexpr std::size_t kLongestPart = 200, kMostParts = 8;

JobState state_of(const std::string& word) {
  const auto at = std::find(kStateWords.begin(), kStateWords.end(), word);
  return at == kStateWords.end() ? JobState::interrupted : JobState(at - kStateWords.begin());
}

StudioJob job_of(const Json& json) {
  StudioJob job{json.at("id"),      json.at("words"), state_of(json.at("state")),
                json.at("message"), json.at("began"), json.at("ended")};
  if (job.words.empty()) throw Error("a job has no words");
  return job;
}

bool is_control_character(char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }

bool is_safe_part(const std::string& part) {
  return !part.empty() && part.front() != '.' && part.size() <= kLongestPart &&
         part.find('\\') == part.npos &&
         std::none_of(part.begin(), part.end(), is_control_character);
}

// What stands behind -o.
std::string output_of(const StudioJob& job) {
  const auto at = std::find(job.words.begin(), job.words.end(), "-o");
  return at == job.words.end() || at + 1 == job.words.end() ? "" : at[1];
}

}  // namespace

const char* word_of(JobState state) { return kStateWords[std::size_t(state)]; }

fs::path Project::log_of(int job) const { return folder / "jobs" / fmt::format("{}.log", job); }

StudioJob& Project::job(int id) {
  const auto at =
      std::find_if(jobs.begin(), jobs.end(), [&](const auto& job) { return job.id == id; });
  if (at == jobs.end()) throw UsageError(fmt::format("the project has no job {}", id));
  return *at;
}

Json to_json(const StudioJob& job) {
  return {{"id", job.id},           {"words", job.words}, {"state", word_of(job.state)},
          {"message", job.message}, {"began", job.began}, {"ended", job.ended}};
}

Project read_project(const fs::path& folder) {
  const fs::path file = folder / "project.json";
  const Json json = read_json(file);
  return take_from_json(file, kRemedy, [&] {
    if (json.at("version") != kVersion)
      throw Error("cannot read " + file.string() + ": a newer gemsplat wrote it; install that one");
    Project project{folder, json.at("name"), json.at("photos"), json.at("left_out"),
                    json.at("model")};
    for (const Json& job : json.at("jobs")) project.jobs.push_back(job_of(job));
    return project;
  });
}

void write_project(const Project& project) {
  Json json = {{"version", kVersion},          {"name", project.name},   {"photos", project.photos},
               {"left_out", project.left_out}, {"model", project.model}, {"jobs", Json::array()}};
  for (const StudioJob& job : project.jobs) json["jobs"].push_back(to_json(job));
  write_text(project.folder / "project.json", file_text(json));
}

fs::path safe_path(const std::string& name) {
  fs::path path;
  std::size_t parts = 0;
  for (std::size_t begin = 0; begin <= name.size(); ++parts) {
    const std::size_t end = std::min(name.find('/', begin), name.size());
    const std::string part = name.substr(begin, end - begin);
    if (!is_utf8(name) || !is_safe_part(part) || parts == kMostParts)
      throw UsageError(fmt::format("{} cannot be the name of a file here; rename it and try again",
                                   name.empty() ? "an empty name" : shown_word(name)));
    path /= part;
    begin = end + 1;
  }
  return path;
}

std::vector<std::string> words_to_go_on(const StudioJob& job) {
  std::vector<std::string> words = job.words;
  const auto has = [&](const char* word) {
    return std::find(words.begin(), words.end(), word) != words.end();
  };
  if (job.verb() == "train" && !has("--resume")) words.emplace_back("--resume");
  const bool writes_file = job.verb() == "edit" || job.verb() == "export" ||
                           job.verb() == "render" || job.verb() == "mesh";
  if (writes_file && !has("--force")) words.emplace_back("--force");
  return words;
}

std::string newest_scene_of(const Project& project) {
  std::string newest;
  fs::file_time_type when{};
  for (const fs::path& path : entries_of(project.folder)) {
    std::error_code none;
    const fs::path model = path / "sparse" / "0";
    if (!is_file(path / "reconstruct.json") || !is_folder(model)) continue;
    if (const auto time = fs::last_write_time(model, none); newest.empty() || time > when) {
      newest = path.filename().string();
      when = time;
    }
  }
  return newest;
}

Json models_of(const Project& project) {
  std::vector<std::pair<fs::file_time_type, Json>> found;
  std::error_code none;
  const auto add = [&](const fs::path& named, const fs::path& file, const char* kind) {
    found.emplace_back(fs::last_write_time(file, none),
                       Json{{"path", is_within(named, project.folder)
                                         ? fs::relative(named, project.folder).string()
                                         : named.string()},
                            {"kind", kind},
                            {"bytes", fs::file_size(file, none)},
                            {"time", fs::last_write_time(file, none).time_since_epoch().count()},
                            {"from", nullptr}});
  };
  for (const fs::path& path : entries_of(project.folder)) {
    const RunFolder run(path);
    if (const auto step = fs::is_directory(path, none) ? run.newest_step() : std::nullopt)
      add(path, run.ply(*step), "run");
  }
  for (const char* folder : {"input", "edits"})
    for (const fs::path& file : entries_of(project.folder / folder))
      if (is_file(file) && find_format(file))
        add(file, file, folder == std::string("input") ? "input" : "file");
  if (is_file(project.photos) && find_format(project.photos))
    add(project.photos, project.photos, "input");
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  Json models = Json::array();
  for (auto& [time, model] : found) {
    for (const StudioJob& job : project.jobs)
      if (job.verb() == "edit" && job.words.size() > 1 && output_of(job) == model["path"])
        model["from"] = job.words[1];
    models.push_back(std::move(model));
  }
  return models;
}

fs::path photo_folder_of(const Project& project) {
  return is_folder(project.input()) ? photo_root(project.input()) : project.input();
}

void choose_photos(const Project& project) {
  const fs::path chosen = project.folder / "chosen", from = photo_folder_of(project);
  fs::remove_all(chosen);
  if (project.left_out.empty()) return;
  const std::set<std::string> left_out(project.left_out.begin(), project.left_out.end());
  for (const std::string& name : picture_names_in(from)) {
    if (left_out.contains(name)) continue;
    fs::create_directories((chosen / name).parent_path());
    std::error_code error;
    fs::create_hard_link(from / name, chosen / name, error);
    if (error) fs::create_symlink(fs::absolute(from / name), chosen / name);
  }
}

bool write_chosen_list(const Project& project, const std::string& scene) {
  std::set<std::string> left_out;
  for (const std::string& name : project.left_out) left_out.insert(without_extension(name));
  DatasetConfig dataset;
  dataset.source = (project.folder / scene).string();  // an absolute scene stays
  std::vector<std::string> names;
  const ColmapModel model = read_scene(dataset, find_scene(dataset)).model;
  for (const ColmapImage& image : model.images)
    if (!left_out.contains(without_extension(image.name))) names.push_back(image.name);
  if (names.size() == model.images.size()) return false;
  if (names.empty()) throw UsageError("all photos of the scene are left out; take some in again");
  write_photo_list(project.folder / "photos.txt", names);
  return true;
}

}  // namespace gs
