// SPDX-License-Identifier: Apache-2.0
// gemsplat view: a trained model in the browser.
#include "gs_app/jobs/parts/open_browser.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/model_mesh.h"
#include "gs_app/run/text.h"
#include "gs_app/view/file_view.h"
#include "gs_core/system/processes/signals.h"
#include "gs_model/mesh/mesh_read.h"

namespace gs {
namespace {

struct ViewJob : JobSettings {
  std::string model, cameras, mesh;
  ModelChoice choice;
  std::optional<double> time;
  HttpPlace place;
  std::optional<bool> open;
  bool remote = false;
  std::size_t stream_from = kWorthStreaming;
};

void visit_options(ViewJob& job, OptionList& option) {
  option("model", job.model, kModelHelp).takes("MODEL|RUN").required();
  time_option(option, job.time,
              "moment of Gaussians in space and time at which the page begins, standing still, 0 "
              "to 1 [it plays from 0 on]");
  model_options(option, job.choice);
  http_options(option, job.place, "--", "Server");
  option.get("--host").is_rare = option.get("--port").is_rare = false;
  open_option(option, job.open);
  option("--remote", job.remote,
         "render on --device and send pictures to the browser, for models that are too large for "
         "it")
      .group("Server");
  option("--stream-from", job.stream_from,
         "smallest number of Gaussians that is streamed in levels of detail, which are made first; "
         "0: none [2000000]")
      .takes("N")
      .group("Server")
      .rare();
  option("--mesh", job.mesh,
         "mesh of the model, a .glb, to be shown in its place [mesh.glb in the run, or what "
         "`gemsplat mesh` writes beside the model]")
      .takes("FILE")
      .group("Scene")
      .excludes("--remote");
  option("--cameras", job.cameras, "cameras.json [that of the run]").takes("FILE").group("Scene");
  camera_options(option, "-d,--data,-s,--source-path");
  option.get("--data").excludes("--cameras");
  mask_options(option);
  render_options(option);
  general_options(option);
}

/// The mesh that was named, or else the one that is there, if it can be read.
std::filesystem::path mesh_to_show(const ViewJob& job) {
  const std::filesystem::path mesh =
      job.mesh.empty() ? mesh_beside(job.model) : std::filesystem::path(job.mesh);
  if (mesh.empty()) return {};
  try {
    if (mesh.extension() == ".glb" && !read_mesh(mesh).mesh.triangles.empty()) return mesh;
    throw UsageError(mesh.string() +
                     ": the page shows triangles of a .glb; write one with "
                     "`gemsplat mesh -o NAME.glb`");
  } catch (const Error& error) {
    if (!job.mesh.empty()) throw;
    log_warning("the mesh is not shown: {}", error.what());
    return {};
  }
}

std::unique_ptr<FileView> view_of(const ViewJob& job, const OpenedModel& opened,
                                  const Config& config) {
  ViewScene scene = view_scene_of(opened, config, job.has("dataset.source"), job.cameras);
  scene.time = job.time;
  scene.path = job.model;
  if (!job.remote) scene.mesh = mesh_to_show(job);
  for (const std::string& note : scene.notes) log_warning("{}", note);
  if (!job.remote)
    return std::make_unique<FileView>(std::move(scene), serve_model(opened, job.stream_from));
  auto renderer = std::make_unique<FrameRenderer>(config.train.device, opened.model,
                                                  view_settings(opened, config), look_of(scene));
  return std::make_unique<FileView>(std::move(scene), opened.model.gaussians.count(),
                                    std::move(renderer));
}

Outcome run(const ViewJob& job, JobEvents& events) {
  check_can_view();
  SignalWait signal;
  const OpenedModel opened = open_model(job.model, job.choice.step);
  if (job.time) check_has_time(opened);
  const Config config = resolve_to_work(job, opened.config);
  const std::unique_ptr<FileView> source = view_of(job, opened, config);
  const HttpServer server(
      job.place, [&](const HttpRequest& request) { return view_answer(*source, request); });
  warn_if_public(job.place, server.port());
  log_info("{}: {} Gaussians, {} cameras; Ctrl-C ends the server", opened.ply.string(),
           with_commas(opened.model.gaussians.count()), source->scene().cameras.size());
  const Json json = {{"url", server.url()}, {"gaussians", opened.model.gaussians.count()}};
  events.say((events.wants_json() ? json.dump() : server.url()) + "\n", true);
  open_browser(server.url(), job.open);
  signal.wait();
  const bool has_cameras = opened.run && std::filesystem::exists(opened.run->cameras());
  const std::string model = shell_word(job.model);
  return {
      "",
      nullptr,
      {has_cameras ? NextCommand{"make a film of it", "gemsplat render " + model + " --path orbit"}
                   : NextCommand{"see what it holds", "gemsplat info " + model}},
      true};
}

}  // namespace

Verb view_verb() {
  return verb_of<ViewJob>(
      "view", VerbGroup::look, "Show a trained model in the browser",
      {"view out/scene", "view model.ply --data scene", "view out/scene --remote --host 0.0.0.0"});
}

}  // namespace gs
