// SPDX-License-Identifier: Apache-2.0
// The projects of a folder, and the jobs that run in them: each one is a child process of this same
// program, with --progress json, in the folder of its project. Start reading here.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "gs_app/studio/job_log.h"
#include "gs_app/studio/project.h"
#include "gs_app/studio/uploads.h"
#include "gs_core/system/processes/process.h"

namespace gs {

/// Nothing that matters is in memory alone: a studio that is killed and started again shows the same
/// projects, and jobs that it had started as interrupted, or as done where they were. Every function
/// may be called from any thread, and throws Error with a line for the page.
class Studio {
 public:
  /// Locks the folder, which it makes if it is not there, and reads its projects. Throws Error if
  /// another studio has it.
  explicit Studio(const std::filesystem::path& folder, UploadLimits limits = {});
  /// Asks the jobs to end as Ctrl-C does, and waits until they have saved their work.
  ~Studio();

  const std::filesystem::path& folder() const { return folder_; }
  /// All projects with their jobs and the progress of those that run.
  Json state();
  /// A project with its photos and models.
  Json details(const std::string& project);
  /// What a job has said: {"warnings", "note", "error", "outcome", ...}.
  Json said(const std::string& project, int job);

  /// Makes a project, with the photos in a folder of this machine where one is named. Returns its
  /// identity, the name of its folder.
  std::string create(const std::string& name, const std::string& typed);
  /// Changes "name", "left_out", "turned" or "model". The folder keeps its name, which runs have
  /// written down.
  void change(const std::string& project, const Json& changes);
  /// Moves the project's folder to removed/, and returns where it is now. It is a project again where
  /// it is moved back. Throws UsageError while a job of it, or a command in it, runs.
  std::filesystem::path remove(const std::string& project);
  /// Puts a job at the end of the project's; {id} in its words stands for its number. Returns it.
  int start(const std::string& project, std::vector<std::string> words);
  int go_on(const std::string& project, int job);
  /// Asks a job to save and end.
  void stop(const std::string& project, int job);
  /// Keeps the mask, a PNG, that was painted on a photo seen turned by so many degrees. One that hides
  /// nothing removes the photo's mask.
  void paint(const std::string& project, const std::string& photo, int degrees,
             const std::string& png);
  /// Keeps a file of a tool of the viewer, "path" or "lasso", and returns it.
  std::string keep(const std::string& project, const std::string& tool, const Json& json);
  /// Runs a verb that only says something, and returns its JSON.
  Json ask(const std::string& project, std::vector<std::string> words);

  /// A copy.
  Project project(const std::string& id);
  std::shared_ptr<Uploads> uploads(const std::string& project);
  /// The address at which a run of this project shows itself; empty where it does not.
  std::string live_view(const std::string& project, int job);

 private:
  struct Entry {
    Project project;
    std::map<int, JobLog> logs;
    pid_t child = 0;  // of the job that runs, where this studio has started it
    std::shared_ptr<Uploads> uploads;
  };

  Entry& entry(const std::string& id);
  JobLog& log(Entry& entry, int job);
  void read_all();
  void add(const std::filesystem::path& folder);
  void run_jobs();
  void look_after(Entry& entry);
  void begin(Entry& entry, StudioJob& job);
  void settle(Entry& entry, StudioJob& job);
  bool has_children() const;

  const std::filesystem::path folder_;
  const Descriptor lock_;  // that no child inherits, such as a browser
  const UploadLimits limits_;
  std::mutex mutex_;  // of what follows
  std::condition_variable changed_;
  std::map<std::string, Entry> entries_;
  bool ends_ = false;
  std::atomic<int> asked_ = 0;
  std::thread runner_;  // children end with the thread that has started them
};

}  // namespace gs
