// SPDX-License-Identifier: Apache-2.0
// gemsplat selftest: checks that this build computes correctly on this machine.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <memory>

#include "apps/cli/devices.h"
#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "gs_app/checks/self_checks.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

struct SelftestCommand : CommandLine {
  bool json = false;
};

struct SelftestReport {
  std::string device;
  std::vector<SelfCheck> gradients, parity;
  std::string left_out;  // why parity was not checked; empty if it was

  std::size_t count() const { return gradients.size() + parity.size(); }
  std::size_t failures() const {
    const auto failures_of = [](const std::vector<SelfCheck>& checks) {
      return std::count_if(checks.begin(), checks.end(),
                           [](const SelfCheck& check) { return !check.agrees(); });
    };
    return std::size_t(failures_of(gradients) + failures_of(parity));
  }
};

std::string why_there_is_no_gpu(const std::string& device) {
  if (device == "cpu") return "--device cpu was given";
  for (const Capability& capability : capabilities())
    if (capability.name == "CUDA") return "no GPU can be used: " + capability.detail;
  return "no GPU can be used";
}

SelftestReport run_checks(const std::string& device) {
  const std::unique_ptr<Backend> backend = make_backend(device);
  SelftestReport report;
  report.device = backend->name();
  log_info("checking gradients on the CPU");
  report.gradients = gradient_checks();
  if (&backend->memory() == &host_memory()) {
    report.left_out = why_there_is_no_gpu(device);
  } else {
    log_info("comparing {} with the CPU", report.device);
    report.parity = parity_checks(*backend);
  }
  return report;
}

Json checks_json(const std::vector<SelfCheck>& checks) {
  auto list = Json::array();
  for (const SelfCheck& check : checks)
    list.push_back({{"what", check.what},
                    {"numbers", check.numbers},
                    {"largest", check.largest},
                    {"rms", check.rms},
                    {"tolerance", check.tolerance},
                    {"scene", check.scene},
                    {"agrees", check.agrees()}});
  return list;
}

std::string report_json(const SelftestReport& report) {
  Json json = {{"device", report.device},
               {"version", kVersion},
               {"agrees", report.failures() == 0},
               {"gradients", checks_json(report.gradients)},
               {"parity", checks_json(report.parity)}};
  if (!report.left_out.empty()) json["parity_left_out"] = report.left_out;
  return json.dump(2) + "\n";
}

std::string table(const std::vector<SelfCheck>& checks) {
  std::string text = fmt::format("  {:<22} {:>9} {:>9} {:>9} {:>9}  {:<6}  {}\n", "what", "numbers",
                                 "largest", "RMS", "tolerance", "agrees", "worst scene");
  for (const SelfCheck& check : checks)
    text += fmt::format("  {:<22} {:>9} {:>9.1e} {:>9.1e} {:>9.1e}  {:<6}  {}\n", check.what,
                        with_commas(check.numbers), check.largest, check.rms, check.tolerance,
                        check.agrees() ? "yes" : "NO", check.scene);
  return text;
}

std::string report_text(const SelftestReport& report) {
  std::string text =
      "Differences are relative to the root mean square of the expected numbers. Their RMS must "
      "be within the tolerance.\n\n";
  text += "gradients of the CPU's renderer, compared with central differences\n";
  text += table(report.gradients);
  text += "\n" + (report.left_out.empty()
                      ? report.device + ", compared with the CPU\n"
                      : "GPU compared with CPU: left out, " + report.left_out + "\n");
  if (report.left_out.empty()) text += table(report.parity);
  const std::size_t failures = report.failures();
  text += failures ? "" : fmt::format("\nall {} agree\n", report.count());
  return text;
}

void selftest(const SelftestCommand& command) {
  setup_log(Verbosity::normal);
  const Config config = resolve(command);
  set_thread_count(config.train.threads);
  const SelftestReport report = run_checks(config.train.device);
  std::cout << (command.json ? report_json(report) : report_text(report)) << std::flush;
  if (const std::size_t failures = report.failures())
    throw Error(fmt::format("{} of {} checks do not agree; please report this with the table above "
                            "and the output of `gemsplat info`",
                            failures, report.count()),
                ExitCode::bug);
}

}  // namespace

void add_selftest(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "selftest", "Check that gradients are right and that the GPU agrees with the CPU");
  const auto command = std::make_shared<SelftestCommand>();
  verb.add_flag("--json", command->json, "print JSON");
  add_setting(verb, *command, "--device", "train.device", "Machine",
              "what to compare with the CPU; cuda:N is the GPU with that number");
  add_setting(verb, *command, "--threads", "train.threads", "Machine");
  verb.callback([command] { selftest(*command); });
}

}  // namespace gs
