// SPDX-License-Identifier: Apache-2.0
// gemsplat info: what a trained model holds; without one, what this build can and cannot do.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "apps/cli/devices.h"
#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/provenance.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_model/formats/model_info.h"

namespace gs {
namespace {

struct InfoCommand {
  std::string model;
  bool json = false;
};

void print_build(bool as_json) {
  const CudaBuild cuda = built_cuda();
  Json json = {{"version", kVersion},
               {"commit", built_commit()},
               {"cuda_toolkit", cuda.toolkit},
               {"cuda_architectures", cuda.architectures}};
  std::string text = describe_build() + "\n";
  for (const Capability& capability : capabilities()) {
    json[capability.name] = {{"available", capability.available}, {"detail", capability.detail}};
    text += fmt::format("  {:<12} {:<4} {}\n", capability.name, capability.available ? "yes" : "NO",
                        capability.detail);
  }
  std::cout << (as_json ? json.dump() + "\n" : text);
}

void info(const InfoCommand& command) {
  setup_log(Verbosity::normal);
  if (command.model.empty()) return print_build(command.json);
  const OpenedModel opened = open_model(command.model, std::nullopt);
  ModelInfo model_info = inspect(opened.model);
  model_info.had_filter_3d = is_ply_with_filter_3d(opened.ply);
  if (command.json) {
    std::cout << to_json_text(model_info) << '\n';
  } else {
    std::cout << printable(opened.ply.string()) << '\n' << describe(model_info);
  }
}

}  // namespace

void add_info(CLI::App& program) {
  CLI::App& verb =
      *program.add_subcommand("info", "Describe a trained model, or what this build can do");
  const auto command = std::make_shared<InfoCommand>();
  verb.add_option("model", command->model, std::string(kModelHelp) + " [none: the build]")
      ->type_name("MODEL|RUN");
  verb.add_flag("--json", command->json, "print JSON");
  verb.callback([command] { info(*command); });
}

}  // namespace gs
