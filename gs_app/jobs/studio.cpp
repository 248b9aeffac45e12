// SPDX-License-Identifier: Apache-2.0
// gemsplat studio: projects from photos to film in the browser.
#include <spdlog/fmt/fmt.h>

#include <cstdlib>

#include "gs_app/jobs/parts/open_browser.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/text.h"
#include "gs_app/studio/studio_server.h"
#include "gs_app/view/http/secret.h"
#include "gs_app/view/view_server.h"
#include "gs_core/system/processes/signals.h"

namespace gs {
namespace {

struct StudioJobRequest : JobSettings {
  std::string folder;
  HttpPlace place;
  std::optional<bool> open;
};

void visit_options(StudioJobRequest& job, OptionList& option) {
  option("folder", job.folder, "the folder of the projects [gemsplat in your home folder]")
      .takes("FOLDER");
  port_option(option, job.place, "--", "Server").is_rare = false;
  open_option(option, job.open);
  option("-q,--quiet", job.quiet, "print warnings and errors only").group("Messages");
}

std::filesystem::path folder_of(const StudioJobRequest& job) {
  if (!job.folder.empty()) return job.folder;
  const char* const home = std::getenv("HOME");
  if (!home || !*home)
    throw UsageError(
        "there is no home folder; name the folder of the projects: gemsplat studio "
        "FOLDER");
  return std::filesystem::path(home) / "gemsplat";
}

Outcome run(const StudioJobRequest& job, JobEvents& events) {
  check_can_view();
  SignalWait signal;
  Studio studio(folder_of(job));
  const std::string secret = new_secret();
  StudioServer pages(studio, secret);
  const HttpServer server(
      job.place, [&](const HttpRequest& request) { return pages.answer(request); }, pages.limits());
  const std::string url = server.url() + secret + "/";
  log_info("the projects are in {}; Ctrl-C ends the studio, and jobs save their work",
           studio.folder().string());
  const Json json = {{"url", url}, {"folder", studio.folder().string()}};
  events.say((events.wants_json() ? json.dump() : url) + "\n", true);
  open_browser(url, job.open);
  signal.wait();
  return {"",
          nullptr,
          {{"go on later", "gemsplat studio " + shell_word(folder_of(job).string())}},
          true};
}

}  // namespace

Verb studio_verb() {
  return verb_of<StudioJobRequest>("studio", VerbGroup::train,
                                   "Go from photos to a model, a film and a page in the browser",
                                   {"studio", "studio projects", "studio --no-open --port 7070"});
}

}  // namespace gs
