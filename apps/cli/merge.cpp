// SPDX-License-Identifier: Apache-2.0
// gemsplat merge: one model of the blocks that `gemsplat partition` has made and that were trained.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "apps/cli/verbs.h"
#include "gs_app/blocks/merge_blocks.h"
#include "gs_app/export/export_model.h"
#include "gs_app/run/text.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

struct MergeCommand {
  std::string partition, output;
  std::vector<std::string> runs;
  std::optional<int> step;
  bool json = false, quiet = false, force = false;
};

void print_json(const MergedBlocks& merged, const ExportedFile& written) {
  Json blocks = Json::array();
  for (const BlockShare& share : merged.shares)
    blocks.push_back({{"name", share.name},
                      {"run", share.run.string()},
                      {"gaussians", share.gaussians},
                      {"kept", share.owned}});
  const Json json = {{"blocks", blocks},
                     {"gaussians", merged.model.model.gaussians.count()},
                     {"output", written.file.string()},
                     {"bytes", written.bytes}};
  std::cout << json.dump(2, ' ', false, Json::error_handler_t::replace) << "\n";
}

void print_text(const MergedBlocks& merged, const ExportedFile& written) {
  for (const BlockShare& share : merged.shares)
    std::cout << fmt::format("{:<8} {:>12} of {:>12} Gaussians\n", share.name,
                             with_commas(share.owned), with_commas(share.gaussians));
  std::cout << summary(written, nullptr) << "\n";
}

void merge(const MergeCommand& command) {
  setup_log(command.quiet ? Verbosity::quiet : Verbosity::normal);
  ExportRequest request{command.output};
  check_export(request, command.force);
  const BlockRuns runs{{command.runs.begin(), command.runs.end()}, command.step};
  const MergedBlocks merged = merge_blocks(read_blocks(command.partition), runs);
  check_holds(format_to_write(command.output), merged.model.model.gaussians.has_time,
              command.output);
  request.input_from_model = merged.model.input_from_model;
  const ExportedFile written = export_model(merged.model.model, request);
  if (command.json)
    print_json(merged, written);
  else if (!command.quiet)
    print_text(merged, written);
}

}  // namespace

void add_merge(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "merge",
      "Make one model of trained blocks: each Gaussian from the block that owns its place");
  const auto command = std::make_shared<MergeCommand>();
  verb.add_option("partition", command->partition,
                  "the folder that `gemsplat partition` has written, or its blocks.json")
      ->type_name("FOLDER|FILE")
      ->required();
  verb.add_option("-o,--output", command->output,
                  "file to write; its ending chooses the format: " + format_names())
      ->type_name("FILE")
      ->required();
  verb.add_option("--run", command->runs,
                  "a block's run that was trained elsewhere than by the partition's experiment; "
                  "its settings name the block; may be repeated")
      ->type_name("RUN")
      ->expected(1)
      ->take_all();
  verb.add_option("--iteration", command->step,
                  "merge the models saved after this step [the last ones of finished runs]")
      ->type_name("STEP");
  verb.add_flag("--json", command->json, "print JSON");
  verb.add_flag("--force", command->force, "if the file exists, move it to FILE.bak-N first");
  verb.add_flag("-q,--quiet", command->quiet, "print warnings and errors only");
  verb.callback([command] { merge(*command); });
}

}  // namespace gs
