// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/studio.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>
#include <sys/file.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <ctime>

#include "gs_app/run/run_folder.h"
#include "gs_app/studio/masks.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/log.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/threads/start_threads.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using JobWords = std::vector<std::string>;

constexpr std::chrono::milliseconds kLookEvery{100};
// What a page may start, and what it may ask while a job runs.
constexpr std::array kJobVerbs = {"doctor", "reconstruct", "train", "edit",
                                  "export", "render",      "eval",  "mesh"};
constexpr std::array kQuestions = {"config", "doctor", "info", "edit"};
constexpr std::size_t kMostWords = 400;
constexpr const char* kRemoved = "removed";  // the folder of projects that were removed

std::int64_t now() { return std::int64_t(std::time(nullptr)); }

template <class Verbs>
void check_verb(const Verbs& verbs, const JobWords& words) {
  const bool is_known =
      !words.empty() && std::find(verbs.begin(), verbs.end(), words.front()) != verbs.end();
  if (!is_known || words.size() > kMostWords)
    throw UsageError("the studio does not run this; start it on a command line");
}

// What the shell gets for the words, and what the studio needs to follow the job.
JobWords command_of(const JobWords& words) {
  JobWords command = {program_to_start().string()};
  command.insert(command.end(), words.begin(), words.end());
  if (words.front() == "train")
    for (const char* word : {"--viewer", "--viewer-port", "0"}) command.emplace_back(word);
  for (const char* word : {"--json", "--progress", "json"}) command.emplace_back(word);
  return command;
}

std::string with_number(std::string word, int id) {
  constexpr std::string_view kPlace = "{id}";
  if (const std::size_t at = word.find(kPlace); at != word.npos)
    word.replace(at, kPlace.size(), std::to_string(id));
  return word;
}

bool is_active(const StudioJob& job) {
  return job.state == JobState::waiting || job.state == JobState::running;
}

// Neither a job nor a command of a terminal writes to the project's folders.
void check_is_idle(const Project& project) {
  if (std::any_of(project.jobs.begin(), project.jobs.end(), is_active))
    throw UsageError("a job of this project runs; stop it first");
  for (const fs::path& path : entries_of(project.folder))
    if (is_job_alive(path / ".gemsplat.lock"))
      throw UsageError("a command writes to " + path.filename().string() +
                       "; wait until it has ended");
}

std::map<std::string, int> turns_in(const Json& json) {
  std::map<std::string, int> turned = json;
  for (const auto& [name, degrees] : turned)
    if (!is_turn(degrees))
      throw UsageError(fmt::format("a photo cannot be turned by {} degrees", degrees));
  std::erase_if(turned, [](const auto& each) { return each.second == 0; });
  return turned;
}

// Nothing has changed where the disk is full.
template <class Change>
void save(Project& project, Change&& change) {
  Project changed = project;
  change(changed);
  write_project(changed);
  project = std::move(changed);
}

Descriptor locked_folder(const fs::path& folder) {
  fs::create_directories(folder);
  Descriptor lock(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (lock < 0) throw Error("cannot read " + folder.string() + "; choose a folder of your own");
  if (::flock(lock, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    throw Error("another studio has " + folder.string() +
                " open; use the address that it printed, or end it with Ctrl-C");
  return lock;
}

// How a job ended, as its log and its process say. Without the latter it is one of an earlier studio.
// A run also stops where somebody presses Stop in its own view.
void end_job(StudioJob& job, const JobLog& log, const std::optional<ProcessEnd>& end,
             bool studio_ends) {
  job.ended = now();
  job.message = log.error;
  const bool was_stopped = end && (end->exit_code == int(ExitCode::interrupted) ||
                                   end->signal == SIGTERM || end->signal == SIGINT);
  if (end ? end->good() : log.error.empty() && !log.outcome.is_null()) {
    job.state = JobState::done;
  } else if (!end || was_stopped) {
    job.state = end && !studio_ends ? JobState::stopped : JobState::interrupted;
  } else {
    job.state = JobState::failed;
    if (job.message.empty() && end->signal != 0)
      job.message = fmt::format(
          "it was ended by signal {}, as by a system that has too little memory", end->signal);
    if (job.message.empty()) job.message = log.note;
  }
}

}  // namespace

Studio::Studio(const fs::path& folder, UploadLimits limits)
    : folder_(fs::absolute(folder)), lock_(locked_folder(folder_)), limits_(limits) {
  read_all();
  std::vector<std::thread> threads;
  start_threads(threads, 1, [this] { run_jobs(); });
  if (threads.empty()) throw Error("cannot start a thread; end other programs");
  runner_ = std::move(threads.front());
}

Studio::~Studio() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
    for (const auto& [id, entry] : entries_)
      if (entry.child > 0) ::kill(entry.child, SIGTERM);
    if (has_children()) log_info("jobs save their work; a second Ctrl-C does not wait for them");
  }
  changed_.notify_all();
  runner_.join();
}

void Studio::read_all() {
  for (const fs::path& path : entries_of(folder_))
    if (is_file(path / "project.json") && !entries_.contains(path.filename().string())) add(path);
}

void Studio::add(const fs::path& folder) {
  try {
    entries_[folder.filename().string()].project = read_project(folder);
  } catch (const Error& error) {
    entries_.erase(folder.filename().string());
    log_warning("{}", error.what());
  }
}

Studio::Entry& Studio::entry(const std::string& id) {
  const auto at = entries_.find(id);
  if (at == entries_.end()) throw UsageError("there is no such project");
  return at->second;
}

JobLog& Studio::log(Entry& entry, int job) {
  const auto [at, is_new] = entry.logs.try_emplace(job, entry.project.log_of(job));
  at->second.update();
  return at->second;
}

// ---- jobs

void Studio::run_jobs() {
  std::string trouble;
  for (std::unique_lock lock(mutex_); !ends_ || has_children();) {
    for (auto& [id, entry] : entries_) {
      try {
        look_after(entry);
      } catch (const std::exception& error) {  // the disk is full: the next look may do better
        if (trouble != error.what())
          log_warning("the project {}: {}", shown_word(id), error.what());
        trouble = error.what();
      }
    }
    changed_.wait_for(lock, kLookEvery);
  }
}

bool Studio::has_children() const {
  return std::any_of(entries_.begin(), entries_.end(),
                     [](const auto& each) { return each.second.child > 0; });
}

void Studio::look_after(Entry& entry) {
  std::vector<StudioJob>& jobs = entry.project.jobs;
  const auto running = std::find_if(jobs.begin(), jobs.end(), [](const StudioJob& job) {
    return job.state == JobState::running;
  });
  if (running != jobs.end()) {
    if (!is_job_alive(entry.project.log_of(running->id))) settle(entry, *running);
    return;
  }
  const auto next = std::find_if(jobs.begin(), jobs.end(), is_active);
  if (next != jobs.end() && !ends_) begin(entry, *next);
}

void Studio::begin(Entry& entry, StudioJob& job) {
  entry.logs.erase(job.id);
  job.began = now();
  job.state = JobState::running;
  try {
    write_project(entry.project);
    const Descriptor log = new_job_log(entry.project.log_of(job.id));
    entry.child = start_child(
        command_of(job.words),
        {.output = log, .folder = entry.project.folder, .saves_on_term = job.verb() == "train"});
  } catch (const Error& error) {
    job.state = JobState::failed;
    job.message = error.what();
    write_project(entry.project);
  }
}

void Studio::settle(Entry& entry, StudioJob& job) {
  std::optional<ProcessEnd> end;
  if (entry.child > 0) end = wait_for_child(std::exchange(entry.child, 0));
  end_job(job, log(entry, job.id), end, ends_);
  write_project(entry.project);
}

int Studio::start(const std::string& project, JobWords words) {
  check_verb(kJobVerbs, words);
  if (words.front() == "reconstruct") make_turned_copies(this->project(project));  // takes a while
  const std::lock_guard lock(mutex_);
  Project& known = entry(project).project;
  StudioJob job{.id = known.jobs.empty() ? 1 : known.jobs.back().id + 1, .words = std::move(words)};
  for (std::string& word : job.words) word = with_number(word, job.id);
  if (job.verb() == "train") set_extra_steps(known.folder, job.words);
  give_photos(known, job);
  save(known, [&](Project& changed) { changed.jobs.push_back(job); });
  changed_.notify_all();
  return job.id;
}

int Studio::go_on(const std::string& project, int id) {
  const std::lock_guard lock(mutex_);
  Project& known = entry(project).project;
  if (is_active(known.job(id))) throw UsageError("this job has not ended");
  save(known, [&](Project& changed) {
    StudioJob& job = changed.job(id);
    job = {.id = id, .words = words_to_go_on(job), .turned = job.turned};
  });
  changed_.notify_all();
  return id;
}

void Studio::stop(const std::string& project, int id) {
  const std::lock_guard lock(mutex_);
  Entry& known = entry(project);
  const StudioJob& job = known.project.job(id);
  if (job.state == JobState::waiting)
    save(known.project, [&](Project& changed) { changed.job(id).state = JobState::stopped; });
  else if (job.state == JobState::running && known.child > 0)
    ::kill(known.child, SIGTERM);
}

Json Studio::ask(const std::string& project, JobWords words) {
  check_verb(kQuestions, words);
  if (words.front() == "edit") words.emplace_back("--dry-run");
  const fs::path folder = this->project(project).folder,
                 file = folder / "jobs" / fmt::format("question-{}.log", ++asked_);
  pid_t child = 0;
  {
    const Descriptor log = new_job_log(file);
    child = start_child(command_of(words), {.output = log, .folder = folder});
  }
  wait_for_child(child);
  JobLog log(file);
  log.update();
  fs::remove(file);
  if (log.outcome.is_null()) throw Error(log.error.empty() ? log.note : log.error);
  return log.outcome;
}

void Studio::paint(const std::string& project, const std::string& photo, int degrees,
                   const std::string& png) {
  const Image8 mask = read_painted_mask(this->project(project), photo, degrees, png);
  const std::lock_guard lock(mutex_);  // the project's folder does not move meanwhile
  keep_mask(entry(project).project, photo, mask);
}

std::string Studio::keep(const std::string& project, const std::string& tool, const Json& json) {
  if (tool != "path" && tool != "lasso") throw UsageError("the viewer has no such tool");
  const fs::path folder = this->project(project).folder;
  for (int i = 1;; ++i) {
    const std::string name = fmt::format("tools/{}-{}.json", tool, i);
    if (is_there(folder / name)) continue;
    write_text(folder / name, file_text(json));
    return name;
  }
}

// ---- projects

Project Studio::project(const std::string& id) {
  const std::lock_guard lock(mutex_);
  return entry(id).project;
}

std::shared_ptr<Uploads> Studio::uploads(const std::string& project) {
  const std::lock_guard lock(mutex_);
  Entry& known = entry(project);
  if (!known.uploads) known.uploads = std::make_shared<Uploads>(known.project.folder, limits_);
  return known.uploads;
}

std::string Studio::live_view(const std::string& project, int id) {
  const std::lock_guard lock(mutex_);
  Entry& known = entry(project);
  return known.project.job(id).state == JobState::running ? log(known, id).viewer : "";
}

std::string Studio::create(const std::string& name, const std::string& typed) {
  const char* const home = std::getenv("HOME");
  const std::string photos = home && typed.starts_with("~/") ? home + typed.substr(1) : typed;
  if (!photos.empty() && (!fs::path(photos).is_absolute() || !is_there(photos)))
    throw UsageError(
        "there is no " + shown_word(photos) +
        " on this machine; type the whole path of a folder or a video, /home/me/photos");
  const std::string stem = safe_path(name).filename().string();
  const std::lock_guard lock(mutex_);
  fs::path folder = folder_ / stem;
  for (int i = 2; is_there(folder) || folder.filename() == kRemoved; ++i)
    folder = folder_ / fmt::format("{}-{}", stem, i);
  fs::create_directories(photos.empty() ? folder / "input" : folder);
  write_project({.folder = folder, .name = folder.filename().string(), .photos = photos});
  add(folder);
  return folder.filename().string();
}

void Studio::change(const std::string& project, const Json& changes) {
  const std::lock_guard lock(mutex_);
  Project& known = entry(project).project;
  save(known, [&](Project& changed) {
    if (changes.contains("name")) changed.name = safe_path(changes["name"]).filename();
    if (changes.contains("model")) changed.model = changes["model"];
    if (changes.contains("left_out")) changed.left_out = changes["left_out"];
    if (changes.contains("turned")) changed.turned = turns_in(changes["turned"]);
  });
}

fs::path Studio::remove(const std::string& project) {
  const std::lock_guard lock(mutex_);
  Entry& known = entry(project);
  const fs::path from = known.project.folder, removed = folder_ / kRemoved;
  check_is_idle(known.project);
  std::unique_lock<std::mutex> no_uploads;
  if (known.uploads && !(no_uploads = known.uploads->pause()))
    throw UsageError("files arrive in this project; wait until they are there");
  fs::create_directories(removed);
  fs::path to = removed / project;
  for (int i = 2; is_there(to); ++i) to = removed / fmt::format("{}-{}", project, i);
  if (const std::error_code error = rename_to_new(from, to))
    throw Error(fmt::format("cannot move {} to {}: {}; move it yourself", from.string(),
                            to.string(), error.message()));
  const std::shared_ptr<Uploads> paused = known.uploads;  // outlives its lock
  entries_.erase(project);
  no_uploads = {};
  return to;
}

}  // namespace gs
