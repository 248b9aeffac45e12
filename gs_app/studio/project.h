// SPDX-License-Identifier: Apache-2.0
// A project of the studio: a folder with one file, project.json, which says what was done in it. All
// else is what the verbs wrote, so the command line goes on where the page stopped, and back.
//
//   project.json    name, photos, photos that are left out or turned, the version that is shown, jobs
//   input/          what was dropped onto the page, where the photos lie in no other folder
//   masks/          masks that were painted: a.jpg.png for the photo a.jpg, as its pixels are stored
//   turned/90/      copies of photos that were turned, by degrees
//   chosen-2/       links to these and to the other photos that were not left out, for COLMAP in job 2
//   photos.txt      the photos of a scene that were not left out, for dataset.photo_list
//   masks-3/        the masks that job 3 uses, as the photos of its scene lie
//   scene-2/ run-3/ edits/4.ply share/5/ films/6.mp4       what job 2, 3, ... made
//   tools/          key frames and lassos of the viewer
//   jobs/3.log      what job 3 said: the lines of --progress json and --json
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "gs_core/system/text/json.h"

namespace gs {

enum class JobState { waiting, running, done, failed, stopped, interrupted };
const char* word_of(JobState state);

/// One call of gemsplat in a project's folder.
struct StudioJob {
  int id = 0;
  std::vector<std::string> words;  // behind "gemsplat"; paths are relative to the project's folder
  JobState state = JobState::waiting;
  std::string message = {};                // why it failed or stopped
  std::int64_t began = 0, ended = 0;       // seconds since 1970; 0: not yet
  std::map<std::string, int> turned = {};  // of a reconstruction: Project::turned, as it saw them

  const std::string& verb() const { return words.front(); }
  /// What stands behind -o; empty if that is missing.
  std::string output() const;
};

struct Project {
  std::filesystem::path folder;
  std::string name = {};
  std::string photos = {};                 // a folder of this machine; empty: input/
  std::vector<std::string> left_out = {};  // photos, by their names below the folder of photos
  std::map<std::string, int> turned = {};  // photos, by 90, 180 or 270 degrees clockwise
  std::string model = {};                  // the version that is shown; empty: the newest
  std::vector<StudioJob> jobs = {};        // in the order of their numbers

  std::string id() const { return folder.filename().string(); }
  std::filesystem::path input() const {
    return photos.empty() ? folder / "input" : std::filesystem::path(photos);
  }
  std::filesystem::path log_of(int job) const;
  /// Throws UsageError if there is none.
  StudioJob& job(int id);
};

/// Throws Error that names the file if it is none of ours.
Project read_project(const std::filesystem::path& folder);
/// Whole or not at all, also where the power fails.
void write_project(const Project& project);

Json to_json(const StudioJob& job);

/// A path below a folder as a stranger gives it: "day 1/a.jpg". Throws UsageError where a part is
/// empty, hidden, ".." or longer than 200 bytes, or holds control characters, a backslash or what is
/// not UTF-8, and for more than eight parts.
std::filesystem::path safe_path(const std::string& name);

/// The words of a job for another try, which goes on where the last one ended: `train` from its
/// checkpoint, `reconstruct` from its folder. Other verbs move a file aside that they had written.
std::vector<std::string> words_to_go_on(const StudioJob& job);

/// Turns "--iterations +N" of `train --resume RUN` into the number of extra steps that the run then has
/// in all, so that another try of a job that was killed at its end does not add them again.
void set_extra_steps(const std::filesystem::path& project, std::vector<std::string>& words);

/// The newest folder in which COLMAP has placed the photos, relative to the project's; empty if there
/// is none.
std::string newest_scene_of(const Project& project);

/// Trained models of the project: {"path", "kind": "run", "file" or "input", "bytes", "time", "from"}, the
/// newest last; "from" is the model that an edit began with.
Json models_of(const Project& project);

}  // namespace gs
