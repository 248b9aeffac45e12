// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/scene_state.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/error.h"
#include "gs_core/io/atomic_file.h"
#include "gs_core/io/move_aside.h"
#include "gs_core/io/read_json.h"
#include "gs_core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Whether the folder holds a result, of whatever program, that would be overwritten.
bool holds_other_work(const ColmapPlan& plan) {
  const SceneFiles& files = plan.files;
  return fs::exists(files.sparse()) || fs::exists(files.database()) ||
         is_colmap_model(files.root) || (fs::exists(files.images()) && !plan.photos_in_place);
}

}  // namespace

SceneState read_state(const SceneFiles& files) {
  constexpr const char* kRemedy = "remove it";
  try {
    const auto json = read_json_as(files.state(), kRemedy);
    return take_from_json(files.state(), kRemedy, [&] {
      return SceneState{json.at("made_of").get<std::string>(),
                        json.at("complete").get<std::set<std::string>>()};
    });
  } catch (const Error&) {  // missing or damaged: nothing is complete
    return {};
  }
}

void write_state(const SceneFiles& files, const SceneState& state) {
  nlohmann::ordered_json json;
  json["made_of"] = state.made_of;
  json["complete"] = state.complete;
  AtomicFile file(files.state());
  file.write(json.dump(2) + "\n");
  file.commit();
}

SceneState prepare_folder(const ColmapPlan& plan, const ColmapJob& job,
                          const std::set<std::string>& stages) {
  const SceneFiles& files = plan.files;
  SceneState state = read_state(files), fresh{made_of(plan), {}};
  const bool ours = !state.made_of.empty(), same = state.made_of == fresh.made_of;
  const bool is_finished =
      std::includes(state.complete.begin(), state.complete.end(), stages.begin(), stages.end());
  if (job.force && (ours || holds_other_work(plan))) {
    if (is_within(job.photos, job.scene))
      throw UsageError(
          fmt::format("cannot move {} away, as --force asks: the photos lie in it; choose another "
                      "scene with -o",
                      job.scene.string()));
    log_warning("the old content of {} was moved to {}", job.scene.string(),
                move_aside(job.scene).string());
    return fresh;
  }
  if (ours && same) return state;
  if (ours && !is_finished) {
    log_warning("photos or settings differ from those of the unfinished scene in {}: starting over",
                job.scene.string());
    for (const fs::path& path : {files.database(), files.log(), files.sparse(), files.attempt()})
      fs::remove_all(path);
    if (!plan.photos_in_place) fs::remove_all(files.images());
    return fresh;
  }
  if (ours || holds_other_work(plan))
    throw UsageError(fmt::format(
        "the folder {} holds a scene already{}; choose another with -o, or give --force to move it "
        "to {}.bak-N first",
        job.scene.string(), ours ? ", of other photos or settings" : "", job.scene.string()));
  return fresh;
}

}  // namespace gs
