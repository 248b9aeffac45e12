// SPDX-License-Identifier: Apache-2.0
// gemsplat view: a trained model in the browser.
#include <CLI/CLI.hpp>
#include <cstdlib>
#include <iostream>
#include <memory>

#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "gs_app/run/text.h"
#include "gs_app/view/file_view.h"
#include "gs_core/error.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/processes/signals.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

struct ViewCommand : CommandLine {
  std::string model, cameras;
  std::optional<int> step;
  std::optional<double> time;
  HttpPlace place;
  std::optional<bool> open;
  bool remote = false;
  std::size_t stream_from = kWorthStreaming;
};

bool has_desktop() {
  const auto is_set = [](const char* name) {
    const char* const value = std::getenv(name);
    return value && *value;
  };
  return is_set("DISPLAY") || is_set("WAYLAND_DISPLAY");
}

// Opens the browser if --open was given, or by default if there is a desktop. It is detached, so
// that Ctrl-C ends only this program.
void open_browser(const std::string& url, std::optional<bool> wish) {
  if (!wish.value_or(has_desktop())) return;
  try {
    start_child({"xdg-open", url}, {.is_detached = true});
  } catch (const Error& error) {
    if (wish) log_warning("cannot open a browser: {}; open {} yourself", error.what(), url);
  }
}

std::unique_ptr<FileView> view_of(const ViewCommand& command, const OpenedModel& opened,
                                  const Config& config) {
  ViewScene scene = view_scene_of(opened, config, command.has("dataset.source"), command.cameras);
  scene.time = command.time;
  scene.path = command.model;
  for (const std::string& note : scene.notes) log_warning("{}", note);
  if (!command.remote)
    return std::make_unique<FileView>(std::move(scene), serve_model(opened, command.stream_from));
  auto renderer = std::make_unique<FrameRenderer>(config.train.device, opened.model,
                                                  view_settings(opened, config), look_of(scene));
  return std::make_unique<FileView>(std::move(scene), opened.model.gaussians.count(),
                                    std::move(renderer));
}

void view(const ViewCommand& command) {
  setup_log(command.verbosity());
  check_can_view();
  SignalWait signal;
  const OpenedModel opened = open_model(command.model, command.step);
  if (command.time) check_has_time(opened);
  const Config config = resolve(command, opened.config);
  set_thread_count(config.train.threads);
  const std::unique_ptr<FileView> source = view_of(command, opened, config);
  const HttpServer server(
      command.place, [&](const HttpRequest& request) { return view_answer(*source, request); });
  warn_if_public(command.place, server.port());
  log_info("{}: {} Gaussians, {} cameras; Ctrl-C ends the server", opened.ply.string(),
           with_commas(opened.model.gaussians.count()), source->scene().cameras.size());
  std::cout << server.url() << std::endl;
  open_browser(server.url(), command.open);
  signal.wait();
}

}  // namespace

void add_view(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand("view", "Show a trained model in the browser");
  const auto command = std::make_shared<ViewCommand>();
  verb.add_option("model", command->model, kModelHelp)->type_name("MODEL|RUN")->required();
  add_time_option(
      verb, command->time,
      "moment of Gaussians in space and time at which the page begins, standing still, 0 to 1 "
      "[it plays from 0 on]");
  verb.add_option("--iteration", command->step,
                  "which model of a run: the one saved after this step [the newest]")
      ->type_name("STEP");
  add_http_place(verb, command->place, "--", "Server");
  verb.add_flag("--open,!--no-open", command->open, "open the browser [yes, if there is a desktop]")
      ->group("Server");
  verb.add_flag("--remote", command->remote,
                "render on --device and send pictures to the browser, for models that are too "
                "large for it")
      ->group("Server");
  verb.add_option("--stream-from", command->stream_from,
                  "smallest number of Gaussians that is streamed in levels of detail, which are "
                  "made first; 0: none [2000000]")
      ->type_name("N")
      ->group("Server");
  verb.add_option("--cameras", command->cameras, "cameras.json [that of the run]")
      ->type_name("FILE")
      ->group("Scene");
  add_camera_options(verb, *command, "-d,--data,-s,--source-path");
  add_mask_options(verb, *command);
  verb.get_option("--data")->excludes("--cameras");
  add_render_options(verb, *command);
  add_general_options(verb, *command);
  verb.callback([command] { view(*command); });
}

}  // namespace gs
