// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/project.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <charconv>

#include "gs_app/run/run_folder.h"
#include "gs_core/config/config.h"
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

// Projects of older versions have none.
std::map<std::string, int> turned_in(const Json& json) {
  return json.contains("turned") ? json["turned"].get<std::map<std::string, int>>()
                                 : std::map<std::string, int>();
}

StudioJob job_of(const Json& json) {
  StudioJob job{json.at("id"),      json.at("words"), state_of(json.at("state")),
                json.at("message"), json.at("began"), json.at("ended"),
                turned_in(json)};
  if (job.words.empty()) throw Error("a job has no words");
  return job;
}

bool is_control_character(char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }

bool is_safe_part(const std::string& part) {
  return !part.empty() && part.front() != '.' && part.size() <= kLongestPart &&
         part.find('\\') == part.npos &&
         std::none_of(part.begin(), part.end(), is_control_character);
}

}  // namespace

const char* word_of(JobState state) { return kStateWords[std::size_t(state)]; }

std::string StudioJob::output() const {
  const auto at = std::find(words.begin(), words.end(), "-o");
  return at == words.end() || at + 1 == words.end() ? "" : at[1];
}

fs::path Project::log_of(int job) const { return folder / "jobs" / fmt::format("{}.log", job); }

StudioJob& Project::job(int id) {
  const auto at =
      std::find_if(jobs.begin(), jobs.end(), [&](const auto& job) { return job.id == id; });
  if (at == jobs.end()) throw UsageError(fmt::format("the project has no job {}", id));
  return *at;
}

Json to_json(const StudioJob& job) {
  Json json = {{"id", job.id},           {"words", job.words}, {"state", word_of(job.state)},
               {"message", job.message}, {"began", job.began}, {"ended", job.ended}};
  if (!job.turned.empty()) json["turned"] = job.turned;
  return json;
}

Project read_project(const fs::path& folder) {
  const fs::path file = folder / "project.json";
  const Json json = read_json(file);
  return take_from_json(file, kRemedy, [&] {
    if (json.at("version") != kVersion)
      throw Error("cannot read " + file.string() + ": a newer gemsplat wrote it; install that one");
    Project project{folder,          json.at("name"), json.at("photos"), json.at("left_out"),
                    turned_in(json), json.at("model")};
    for (const Json& job : json.at("jobs")) project.jobs.push_back(job_of(job));
    return project;
  });
}

void write_project(const Project& project) {
  Json json = {{"version", kVersion},      {"name", project.name},
               {"photos", project.photos}, {"left_out", project.left_out},
               {"turned", project.turned}, {"model", project.model},
               {"jobs", Json::array()}};
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

void set_extra_steps(const fs::path& project, std::vector<std::string>& words) {
  const auto steps = std::find(words.begin(), words.end(), "--iterations"),
             run = std::find(words.begin(), words.end(), "--resume");
  if (words.end() - steps < 2 || words.end() - run < 2 || !steps[1].starts_with('+')) return;
  const RunFolder folder(project / run[1]);
  int added = 0;
  const char* const end = steps[1].data() + steps[1].size();
  const auto [stop, error] = std::from_chars(steps[1].data() + 1, end, added);
  if (error != std::errc() || stop != end || !is_file(folder.config())) return;  // train says so
  Config config;
  load_config(config, folder.config());
  steps[0] = "--set";
  steps[1] = fmt::format("train.extra_steps={}", config.train.extra_steps + std::int64_t(added));
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
      if (job.verb() == "edit" && job.words.size() > 1 &&
          job.output() == model["path"].get<std::string>())
        model["from"] = job.words[1];
    models.push_back(std::move(model));
  }
  return models;
}

}  // namespace gs
