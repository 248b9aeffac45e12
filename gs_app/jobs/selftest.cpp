// SPDX-License-Identifier: Apache-2.0
// gemsplat selftest: checks that this build computes correctly on this machine.
#include <algorithm>

#include "gs_app/checks/self_checks.h"
#include "gs_app/jobs/parts/capabilities.h"
#include "gs_app/jobs/parts/job.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/text.h"
#include "gs_core/system/version.h"

namespace gs {
namespace {

struct SelftestJob : JobSettings {};

void visit_options(SelftestJob&, OptionList& option) {
  option.setting("--device", "train.device", "Machine",
                 "what to compare with the CPU; cuda:N is the GPU with that number");
  option.setting("--threads", "train.threads", "Machine");
}

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

Json json_of(const SelftestReport& report) {
  Json json = {{"device", report.device},
               {"version", kVersion},
               {"agrees", report.failures() == 0},
               {"gradients", checks_json(report.gradients)},
               {"parity", checks_json(report.parity)}};
  if (!report.left_out.empty()) json["parity_left_out"] = report.left_out;
  return json;
}

std::string table_of(const std::vector<SelfCheck>& checks) {
  std::string text = fmt::format("  {:<22} {:>9} {:>9} {:>9} {:>9}  {:<6}  {}\n", "what", "numbers",
                                 "largest", "RMS", "tolerance", "agrees", "worst scene");
  for (const SelfCheck& check : checks)
    text += fmt::format("  {:<22} {:>9} {:>9.1e} {:>9.1e} {:>9.1e}  {:<6}  {}\n", check.what,
                        with_commas(check.numbers), check.largest, check.rms, check.tolerance,
                        check.agrees() ? "yes" : "NO", check.scene);
  return text;
}

std::string text_of(const SelftestReport& report) {
  std::string text =
      "Differences are relative to the root mean square of the expected numbers. Their RMS must "
      "be within the tolerance.\n\n";
  text += "gradients of the CPU's renderer, compared with central differences\n";
  text += table_of(report.gradients);
  text += "\n" + (report.left_out.empty()
                      ? report.device + ", compared with the CPU\n"
                      : "GPU compared with CPU: left out, " + report.left_out + "\n");
  if (report.left_out.empty()) text += table_of(report.parity);
  const std::size_t failures = report.failures();
  text += failures ? "" : fmt::format("\nall {} agree\n", report.count());
  return text;
}

Outcome run(const SelftestJob& job, JobEvents&) {
  const Config config = resolve_to_work(job);
  const SelftestReport report = run_checks(config.train.device);
  Outcome outcome{text_of(report), json_of(report), {}, true};
  if (const std::size_t failures = report.failures())
    outcome.failure.emplace(
        fmt::format("{} of {} checks do not agree; please report this with the table above and the "
                    "output of `gemsplat info`",
                    failures, report.count()),
        ExitCode::bug);
  else
    outcome.next = {{"time it", "gemsplat bench --gaussians 100000"}};
  return outcome;
}

}  // namespace

Verb selftest_verb() {
  return verb_of<SelftestJob>("selftest", VerbGroup::check,
                              "Check that gradients are right and that the GPU agrees with the CPU",
                              {"selftest", "selftest --device cpu", "selftest --json"});
}

}  // namespace gs
