// SPDX-License-Identifier: Apache-2.0
// What the studio's page is told.
#include "data_loaders/reconstruct/photo_folder.h"
#include "gs_app/studio/masks.h"
#include "gs_app/studio/studio.h"
#include "gs_core/system/files/access.h"

namespace gs {

namespace fs = std::filesystem;

Json Studio::state() {
  const std::lock_guard lock(mutex_);
  read_all();
  Json projects = Json::array();
  for (auto& [id, entry] : entries_) {
    Json jobs = Json::array();
    for (const StudioJob& job : entry.project.jobs) {
      jobs.push_back(to_json(job));
      if (job.state != JobState::running) continue;
      const JobLog& said = log(entry, job.id);
      jobs.back()["progress"] = said.progress;
      jobs.back()["note"] = said.note;
      jobs.back()["viewer"] = !said.viewer.empty();
    }
    projects.push_back({{"id", id}, {"name", entry.project.name}, {"jobs", jobs}});
  }
  return {{"folder", folder_.string()}, {"projects", projects}};
}

Json Studio::details(const std::string& id) {
  const Project known = project(id);
  const bool is_video = is_file(known.input());
  const auto pictures = is_video ? std::vector<std::string>() : photos_of(known);
  std::vector<std::string> videos;
  if (is_video || pictures.empty())
    for (const fs::path& video : find_videos(known.input())) videos.push_back(video.filename());
  const bool is_scene = !pictures.empty() && !holds_only_photos(known.input());
  Json json = {{"id", id},
               {"name", known.name},
               {"folder", known.folder.string()},
               {"photos", known.photos.empty() ? "input" : known.photos},
               {"pictures", pictures},
               {"videos", videos},
               {"left_out", known.left_out},
               {"turned", known.turned},
               {"masked", painted_masks(known)},
               {"has_own_masks", !own_masks_of(known).empty()},
               {"model", known.model},
               {"models", models_of(known)},
               {"scene", nullptr}};
  if (is_scene)
    json["scene"] = json["photos"];
  else if (const std::string scene = newest_scene_of(known); !scene.empty())
    json["scene"] = scene;
  return json;
}

Json Studio::said(const std::string& project, int id) {
  const std::lock_guard lock(mutex_);
  Entry& known = entry(project);
  const StudioJob& job = known.project.job(id);
  const JobLog& said = log(known, job.id);
  return {{"job", to_json(job)}, {"warnings", said.warnings}, {"note", said.note},
          {"error", said.error}, {"outcome", said.outcome},   {"progress", said.progress}};
}

}  // namespace gs
