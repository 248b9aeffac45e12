// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/scene_state.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <algorithm>

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
const OwnedFiles::Stamps kWrittenByColmap = {{"database.db", ""},
                                             {"database.db-journal", ""},
                                             {"database.db-shm", ""},
                                             {"database.db-wal", ""},
                                             {"colmap.log", ""}};

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

// Whether the models are there, or where a kill has left them (SceneFolder::take_models()).
bool has_models(const SceneFiles& files, const SceneState& state) {
  const fs::path left = files.root / state.work / "sparse";
  return fs::exists(files.sparse()) || (!state.work.empty() && fs::exists(left));
}

[[noreturn]] void refuse_models(const fs::path& sparse) {
  throw UsageError(
      fmt::format("{} is there, and is not of this reconstruction, so it is left alone; move it "
                  "away, or choose "
                  "another folder with -o",
                  sparse.string()));
}

}  // namespace

std::optional<SceneState> read_state(const SceneFiles& files) {
  std::error_code ignored;
  if (fs::symlink_status(files.state(), ignored).type() == fs::file_type::not_found)
    return std::nullopt;
  constexpr const char* kRemedy = "choose another folder with -o, or move that file away";
  try {
    const auto json = read_json_as(files.state(), kRemedy);
    return take_from_json(files.state(), kRemedy, [&] {
      SceneState state;
      state.made_of = json.at("made_of").get<std::string>();
      state.complete = json.at("complete").get<std::set<std::string>>();
      // A scene of gemsplat 0.1.0 has no list: COLMAP's files are ours, and pictures are left alone.
      state.files = json.value("files", kWrittenByColmap);
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

SceneFolder::SceneFolder(const SceneFiles& files, SceneState state)
    : paths_(files), state_(std::move(state)),
      owned_(files.root, state_.files, [this](const OwnedFiles::Stamps& now) {
        state_.files = now;
        save();
      }) {
  finish_taking_models();
  remove_work();
}

SceneFolder::~SceneFolder() {
  try {
    remove_work();
  } catch (const Error& error) {
    log_warning("the work folder is still on record: {}; the same command tidies up", error.what());
  } catch (const std::exception&) {  // no memory: the next process tidies up
  }
}

void SceneFolder::save() const {
  Json json;
  json["made_of"] = state_.made_of;
  json["complete"] = state_.complete;
  json["files"] = state_.files;
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

const fs::path& SceneFolder::work() {
  if (work_.empty()) {
    work_ = make_work_folder(paths_.root);
    state_.work = work_.filename().string();
    save();
  }
  return work_;
}

void SceneFolder::remove_work() {
  if (state_.work.empty()) return;
  const fs::path work = paths_.root / state_.work;
  if (!remove_work_folder(work)) {  // it stays on record
    log_warning("{} cannot be removed now; the same command tries again", work.string());
    return;
  }
  state_.work.clear();
  work_.clear();
  save();
}

void SceneFolder::take_models(const std::string& stage) {
  if (fs::exists(paths_.sparse())) refuse_models(paths_.sparse());
  complete(stage);
  finish_taking_models();
}

// A folder of models in the work folder is whole once the stage is complete.
void SceneFolder::finish_taking_models() {
  const fs::path models = paths_.root / state_.work / "sparse";
  if (state_.work.empty() || !state_.complete.contains("model") || !fs::is_directory(models))
    return;
  const std::error_code error = rename_to_new(models, paths_.sparse());
  if (error == std::errc::file_exists) refuse_models(paths_.sparse());
  if (error)
    throw Error(fmt::format("cannot move {} to {}: {}; the same command tries again",
                            models.string(), paths_.sparse().string(), error.message()));
}

// What the file says in between belongs to no photos, so that after a kill every command starts over.
void SceneFolder::start_over(const std::string& made_of) {
  state_.complete.clear();
  state_.made_of.clear();
  save();
  owned_.remove_all();
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
  if (is_same && !has_models(files, *state)) state->complete.erase("model");
  const bool is_finished = state && std::includes(state->complete.begin(), state->complete.end(),
                                                  stages.begin(), stages.end());
  if (state && !state->complete.contains("model") && fs::exists(files.sparse()))
    refuse_models(files.sparse());
  if (!job.force && !is_same && (state ? is_finished : is_in_the_way))
    throw UsageError(fmt::format(
        "the folder {} holds a scene already{}; choose another with -o, or give --force to move it "
        "to {}.bak-N first",
        job.scene.string(), state ? ", of other photos or settings" : "", job.scene.string()));
  auto folder = std::make_unique<SceneFolder>(files, state.value_or(fresh));
  // Pictures that an earlier command put there are the photos of this one.
  if (plan.photos_in_place) folder->files().forget("images/");
  if (state && !is_same) {
    log_warning("photos or settings differ from those of the unfinished scene in {}: starting over",
                job.scene.string());
    folder->start_over(fresh.made_of);
  }
  if (!is_same || !is_finished) folder->files().claim(kWrittenByColmap);
  return folder;
}

}  // namespace gs
