// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/scene_state.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// What COLMAP writes: its database with the files that SQLite keeps beside it, and its log.
constexpr const char* kWrittenByColmap[] = {"database.db", "database.db-journal", "database.db-shm",
                                            "database.db-wal", "colmap.log"};
constexpr std::string_view kWorkFolder = ".gemsplat-";
constexpr std::size_t kRandomLetters = 6;  // of mkdtemp

// Whether the folder holds a result, of whatever program, that would be overwritten.
bool holds_other_work(const ColmapPlan& plan) {
  const SceneFiles& files = plan.files;
  return fs::exists(files.sparse()) || fs::exists(files.database()) ||
         is_colmap_model(files.root) || (fs::exists(files.images()) && !plan.photos_in_place);
}

// COLMAP does not sync what it writes.
void sync_to_disk(const fs::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
#ifdef __linux__
  ::syncfs(descriptor);
#else
  ::sync();
#endif
  ::close(descriptor);
}

void refuse_if_there(const fs::path& path) {
  if (is_there(path))
    throw UsageError(
        fmt::format("{} is there, and is not of this reconstruction, so it is left alone; move it "
                    "away, or choose another folder with -o",
                    path.string()));
}

}  // namespace

std::optional<SceneState> read_state(const SceneFiles& files) {
  if (!is_there(files.state())) return std::nullopt;
  constexpr const char* kRemedy = "choose another folder with -o, or move that file away";
  try {
    const auto json = read_json_as(files.state(), kRemedy);
    return take_from_json(files.state(), kRemedy, [&] {
      SceneState state;
      state.made_of = json.at("made_of").get<std::string>();
      state.complete = json.at("complete").get<std::set<std::string>>();
      state.work = json.value("work", "");
      if (!is_work_folder(state.work)) state.work.clear();
      return state;
    });
  } catch (const AccessError&) {
    throw;
  } catch (const Error&) {
    throw UsageError(fmt::format(
        "{} is damaged, or not of gemsplat reconstruct, so the folder is left alone; {}",
        files.state().string(), kRemedy));
  }
}

bool is_work_folder(const std::string& name) {
  return name.size() == kWorkFolder.size() + kRandomLetters && name.starts_with(kWorkFolder) &&
         std::all_of(name.begin() + kWorkFolder.size(), name.end(),
                     [](unsigned char c) { return std::isalnum(c); });
}

SceneFolder::SceneFolder(const SceneFiles& files, SceneState state)
    : paths_(files), state_(std::move(state)) {
  if (!state_.work.empty()) paths_.work = paths_.root / state_.work;
  if (has("model")) move_in();
}

void SceneFolder::save() const {
  Json json;
  json["made_of"] = state_.made_of;
  json["complete"] = state_.complete;
  json["work"] = state_.work;
  AtomicFile file(paths_.state());
  file.write(file_text(json));
  file.commit();
}

void SceneFolder::complete(const std::string& stage) {
  sync_to_disk(paths_.root);
  state_.complete.insert(stage);
  save();
}

fs::path SceneFolder::work() {
  if (state_.work.empty() || !fs::is_directory(paths_.work)) {
    std::string name = (paths_.root / kWorkFolder).string() + std::string(kRandomLetters, 'X');
    if (!::mkdtemp(name.data()))
      throw Error(fmt::format("cannot make a folder in {}: {}; choose another with -o",
                              paths_.root.string(), std::strerror(errno)));
    paths_.work = name;
    state_.work = paths_.work.filename().string();
    save();
  }
  return paths_.work;
}

void SceneFolder::remove_work() {
  if (state_.work.empty()) return;
  std::error_code ignored;
  fs::remove_all(paths_.work, ignored);
  if (is_there(paths_.work)) {  // it stays on record
    log_warning("{} cannot be removed now; the same command tries again", paths_.work.string());
    return;
  }
  state_.work.clear();
  paths_.work.clear();
  save();
}

void SceneFolder::finish(const std::string& stage) {
  refuse_if_there(paths_.sparse());
  if (fs::exists(paths_.new_images())) refuse_if_there(paths_.images());
  complete(stage);
  move_in();
}

// Both folders are whole once the last stage is complete. A scene is known by its models, so that
// they come last.
void SceneFolder::move_in() {
  if (state_.work.empty()) return;
  for (const auto& [from, to] : {std::pair(paths_.new_images(), paths_.images()),
                                 std::pair(paths_.new_sparse(), paths_.sparse())}) {
    if (!fs::is_directory(from)) continue;
    const std::error_code error = rename_to_new(from, to);
    if (error == std::errc::file_exists) refuse_if_there(to);
    if (error)
      throw Error(fmt::format("cannot move {} to {}: {}; the same command tries again",
                              from.string(), to.string(), error.message()));
  }
  remove_work();
}

// What the file says in between belongs to no photos, so that after a kill every command starts over.
void SceneFolder::start_over(const std::string& made_of) {
  state_.complete.clear();
  state_.made_of.clear();
  save();
  remove_work();
  std::error_code ignored;
  for (const char* name : kWrittenByColmap) fs::remove(paths_.root / name, ignored);
  state_.made_of = made_of;
  save();
}

std::unique_ptr<SceneFolder> prepare_folder(const ColmapPlan& plan, const ColmapJob& job,
                                            const std::set<std::string>& stages, OutputLock& lock) {
  const SceneFiles& files = plan.files;
  const SceneState fresh{made_of(plan), {}};
  std::optional<SceneState> state;
  if (!job.force) state = read_state(files);
  const bool is_in_the_way = holds_other_work(plan) || fs::exists(files.state());
  if (job.force && is_in_the_way)
    log_warning("the old content of {} was moved to {}", job.scene.string(),
                lock.move_folder_aside({job.photos}).string());
  const bool is_same = state && state->made_of == fresh.made_of;
  const auto is_at_work = [&](const char* name) {
    return state && !state->work.empty() && fs::exists(files.root / state->work / name);
  };
  if (is_same && !fs::exists(files.sparse()) && !is_at_work("sparse"))
    state->complete.erase("model");
  const bool is_made = state && state->complete.contains("model");
  if (is_same && !is_made && !fs::exists(files.images()) && !is_at_work("images"))
    state->complete.clear();
  const bool is_finished = state && std::includes(state->complete.begin(), state->complete.end(),
                                                  stages.begin(), stages.end());
  if (!job.force && !is_same && (state ? is_finished : is_in_the_way))
    throw UsageError(fmt::format(
        "the folder {} holds a scene already{}; choose another with -o, or give --force to move it "
        "to {}.bak-N first",
        job.scene.string(), state ? ", of other photos or settings" : "", job.scene.string()));
  if (state && !is_made) {
    refuse_if_there(files.sparse());
    // Of a scene whose sparse/ was removed, the photos are in images/.
    const bool was_made = is_same && state->complete.contains("features") && !is_at_work("images");
    if (!plan.photos_in_place && !was_made) refuse_if_there(files.images());
  }
  if (!state)
    for (const char* name : kWrittenByColmap) refuse_if_there(files.root / name);
  auto folder = std::make_unique<SceneFolder>(files, state.value_or(fresh));
  if (state && !is_same) {
    log_warning("photos or settings differ from those of the unfinished scene in {}: starting over",
                job.scene.string());
    folder->start_over(fresh.made_of);
  }
  return folder;
}

}  // namespace gs
