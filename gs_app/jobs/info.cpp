// SPDX-License-Identifier: Apache-2.0
// gemsplat info: what a trained model holds; without one, what this build can and cannot do.
#include <spdlog/fmt/fmt.h>

#include "gs_app/jobs/parts/capabilities.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/provenance.h"
#include "gs_app/run/text.h"
#include "gs_core/system/version.h"
#include "gs_model/formats/model_info.h"

namespace gs {
namespace {

struct InfoJob : JobSettings {
  std::string model;  // empty: the build
};

void visit_options(InfoJob& job, OptionList& option) {
  option("model", job.model, std::string(kModelHelp) + " [none: the build]").takes("MODEL|RUN");
}

Outcome describe_this_build() {
  const CudaBuild cuda = built_cuda();
  Outcome outcome;
  outcome.json = {{"version", kVersion},
                  {"commit", built_commit()},
                  {"cuda_toolkit", cuda.toolkit},
                  {"cuda_architectures", cuda.architectures}};
  outcome.text = describe_build() + "\n";
  for (const Capability& capability : capabilities()) {
    outcome.json[capability.name] = {{"available", capability.available},
                                     {"detail", capability.detail}};
    outcome.text += fmt::format("  {:<12} {:<4} {}\n", capability.name,
                                capability.available ? "yes" : "NO", capability.detail);
  }
  outcome.next = {{"check that it computes right", "gemsplat selftest"}};
  return outcome;
}

Outcome run(const InfoJob& job, JobEvents&) {
  if (job.model.empty()) return describe_this_build();
  const OpenedModel opened = open_model(job.model, std::nullopt);
  ModelInfo info = inspect(opened.model);
  info.had_filter_3d = is_ply_with_filter_3d(opened.ply);
  return {printable(opened.ply.string()) + "\n" + describe(info),
          Json::parse(to_json_text(info)),
          {{"look at it", "gemsplat view " + shell_word(job.model)}}};
}

}  // namespace

Verb info_verb() {
  return verb_of<InfoJob>("info", VerbGroup::check,
                          "Describe a trained model, or what this build can do",
                          {"info", "info out/scene", "info model.ply --json"});
}

}  // namespace gs
