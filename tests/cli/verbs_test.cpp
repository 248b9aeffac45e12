// SPDX-License-Identifier: Apache-2.0
// What all verbs have in common, because it comes from their lists: help, JSON, progress, the page
// of commands. And what a new user types.
#include <gmock/gmock.h>

#include <regex>
#include <sstream>

#include "gs_app/view/view_server.h"
#include "gs_core/system/text/json.h"
#include "tests/support/fake_colmap.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr int kMostFlags = 15;  // of --help, besides those that ask for help

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

int count_lines(const std::string& text, const std::string& pattern) {
  const std::regex wanted(pattern);
  const std::vector<std::string> lines = lines_of(text);
  return int(std::count_if(lines.begin(), lines.end(), [&](const std::string& line) {
    return std::regex_search(line, wanted);
  }));
}

class VerbList : public Program {
 protected:
  // As `gemsplat --help` lists them.
  std::vector<std::string> names() {
    std::vector<std::string> result;
    const std::regex verb("^  ([a-z-]+) .*");
    std::smatch match;
    for (const std::string& line : lines_of(run("--help").out))
      if (std::regex_match(line, match, verb)) result.push_back(match[1]);
    return result;
  }
};

TEST_F(VerbList, StandInFiveGroups) {
  EXPECT_THAT(run("--help").out,
              AllOf(HasSubstr("\nTrain:\n"), HasSubstr("\nLook:\n"), HasSubstr("\nChange:\n"),
                    HasSubstr("\nCompare:\n"), HasSubstr("\nCheck:\n")));
  EXPECT_EQ(names().size(), 20u);
}

TEST_F(VerbList, HelpShowsWhatMostPeopleNeedWithExamplesAndHelpAllShowsTheRest) {
  for (const std::string& verb : names()) {
    const std::string help = run(verb + " --help").out, all = run(verb + " --help-all").out;
    EXPECT_LE(count_lines(help, "^  -"), kMostFlags + 2) << verb;
    EXPECT_EQ(count_lines(help, "^  gemsplat " + verb), 3) << verb;
    EXPECT_GE(count_lines(all, "^  -"), count_lines(help, "^  -")) << verb;
    EXPECT_THAT(all, HasSubstr("--progress bar|json|none")) << verb;
    for (const std::string& line : lines_of(help + all)) EXPECT_LE(line.size(), 100u) << line;
  }
}

TEST_F(VerbList, ThePageOfCommandsIsWhatTheProgramPrints) {
  EXPECT_EQ(read_bytes(fs::path(GS_SOURCE_DIR) / "docs/reference/commands.md"),
            run("self-doc --markdown").out);
}

TEST_F(VerbList, AnswerInJson) {
  ASSERT_EQ(train("run").code, 0);
  write_bytes(path("e.toml"), "output = '" + text("e") + "'\nscenes = ['" + text("scene") +
                                  "']\nconfigs = ['fast']\n");
  for (const std::string& command :
       {"info", "config", "config --list", "config explain loss", "config diff fast"})
    EXPECT_FALSE(SortedJson::parse(run(command + std::string(" --json")).out).empty()) << command;
  for (const std::string& command :
       {"info " + text("run"), "doctor " + text("scene"), "eval " + text("run"),
        "edit " + text("run") + " --recenter --dry-run", "report " + text("run"),
        "render " + text("run") + " -o " + text("pictures"),
        "export " + text("run") + " " + text("a.splat"),
        "undistort " + text("scene") + " -o " + text("flat"),
        "partition " + text("scene") + " --dry-run",
        "georef " + text("scene") + " --origin 8.5,47.4,400",
        "experiment " + text("e.toml") + " --dry-run"}) {
    const Outcome outcome = run(command + " --json");
    EXPECT_EQ(outcome.code, 0) << command << outcome.err;
    EXPECT_FALSE(SortedJson::parse(outcome.out).empty()) << command;
  }
}

TEST_F(VerbList, ProgressAndMessagesAreLinesOfJsonIfAskedFor) {
  const Outcome outcome = train("run", "--iterations 200 --progress json --json");
  ASSERT_EQ(outcome.code, 0);
  const SortedJson result = SortedJson::parse(outcome.out);
  EXPECT_EQ(result.at("folder"), text("run"));
  EXPECT_EQ(result.at("results").at("iterations"), 200);
  EXPECT_THAT(result.at("next").at(0).get<std::string>(), HasSubstr("gemsplat "));
  int last = 0, logs = 0;
  for (const std::string& line : lines_of(outcome.err)) {
    const SortedJson event = SortedJson::parse(line);
    logs += event.at("event") == "log";
    if (event.at("event") == "progress" && event.at("unit") == "step") last = event.at("done");
  }
  EXPECT_EQ(last, 200);
  EXPECT_GT(logs, 0);
  const Outcome wrong = run("train --progress json " + text("nowhere"));
  EXPECT_EQ(wrong.code, 3);
  const SortedJson error = SortedJson::parse(lines_of(wrong.err).back());
  EXPECT_EQ(error.at("event"), "error");
  EXPECT_THAT(error.at("text").get<std::string>(), HasSubstr("nowhere"));
}

TEST_F(VerbList, ARunHasAFolderBesideTheSceneAndSaysSo) {
  write_scene(path("scene"));
  const Outcome first = run("train " + text("scene/") + kTrain);
  ASSERT_EQ(first.code, 0) << first.err;
  EXPECT_THAT(first.err, HasSubstr("writing to " + text("scene-run") + "; -o names another"));
  EXPECT_TRUE(fs::exists(path("scene-run/results.json")));
  EXPECT_THAT(run("train " + text("scene") + kTrain).err, HasSubstr("--resume goes on with it"));
}

// The place that a call has said and written to.
std::string place_of(const Outcome& outcome) {
  const std::size_t at = outcome.err.find("writing to "), end = outcome.err.find("; -o names", at);
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_NE(end, outcome.err.npos) << outcome.err;
  return outcome.err.substr(at + 11, end - at - 11);
}

TEST_F(VerbList, WhatIsWrittenStandsBesideTheInputAndOverNothing) {
  ASSERT_EQ(train("run").code, 0);
  const std::string scene = text("scene"), run_folder = text("run");
  const std::vector<std::pair<std::string, std::string>> calls = {
      {"render " + run_folder, "run-pictures"},
      {"export " + run_folder + " --no-measure", "run.spz"},
      {"export " + run_folder + " --table --no-measure", "run-formats"},
      {"edit " + run_folder + " --recenter", "run-edited.ply"},
      {"edit " + run_folder + " " + run_folder + " --as-stored", "run-merged.ply"},
      {"undistort " + scene, "scene-undistorted"},
      {"partition " + scene, "scene-blocks"}};
  for (const auto& [call, name] : calls) {
    const std::string stem = fs::path(name).stem(), ending = fs::path(name).extension();
    EXPECT_EQ(place_of(run(call)), text(name)) << call;
    EXPECT_TRUE(fs::exists(path(name))) << call;
    EXPECT_EQ(place_of(run(call)), text(stem + "-2" + ending)) << call;
  }
  EXPECT_EQ(place_of(run("edit " + text("run.spz") + " --recenter")), text("run-edited.spz"));
  EXPECT_EQ(place_of(run("export " + text("run.spz") + " --no-measure")), text("run.ply"));
  EXPECT_EQ(place_of(run("report " + run_folder)), text("run/report.html"));
  EXPECT_EQ(place_of(run("georef " + scene + " --origin 8.5,47.4,400")), text("scene/georef.json"));
  EXPECT_EQ(run("export " + run_folder + " -o " + text("named.ply") + " --no-measure").code, 0);
  EXPECT_TRUE(fs::exists(path("named.ply")));
}

TEST_F(VerbList, WhatIsRelativeStaysSo) {
  ASSERT_EQ(train("run").code, 0);
  const std::string there = "cd " + text("run") + " && ";
  EXPECT_EQ(place_of(run("edit ../run/ --recenter", there)), "../run-edited.ply");
  EXPECT_EQ(place_of(run("edit . --recenter", there)), "../run-edited-2.ply");
}

// A call of each verb that shows something at its end.
std::vector<std::string> calls_of(const std::string& verb, const std::string& folder) {
  const std::string scene = folder + "/scene", run = folder + "/run";
  const std::map<std::string, std::vector<std::string>> calls = {
      {"studio", {"studio " + folder + "/projects --no-open --port 0"}},
      {"train", {"train " + scene + kTrain, "train " + scene + " --print-config"}},
      {"reconstruct", {"reconstruct " + folder + "/photos --colmap " + folder + "/colmap"}},
      {"partition", {"partition " + scene}},  // a dry run says it in its text
      {"view", {"view " + run + " --no-open --port 0"}},
      {"render", {"render " + run}},
      {"report", {"report " + run}},
      {"edit", {"edit " + run + " --recenter", "edit " + run + " --recenter --dry-run"}},
      {"export",
       {"export " + run + " --no-measure", "export " + run + " --table --no-measure",
        "export " + run + " " + folder + "/page.html",
        "export " + run + " " + folder + "/tiles/ --georef " + scene + "/georef.json"}},
      {"mesh", {"mesh " + run + " --voxel 0.2"}},
      {"undistort", {"undistort " + scene}},
      {"georef", {"georef " + scene + " --origin 8.5,47.4,400 --force"}},
      {"eval", {"eval " + run}},
      {"mesh-error",
       {"mesh-error " + folder + "/run-mesh.glb " + folder + "/run-mesh.glb --samples 1000"}},
      {"experiment",
       {"experiment " + folder + "/e.toml --dry-run",
        "experiment " + folder + "/e.toml --slurm --dry-run",
        "experiment " + folder + "/e.toml --only 0", "experiment " + folder + "/e.toml"}},
      {"bench", {"bench --gaussians 500 --width 48 --height 32 --steps 1 --warmup 0 --frames 1"}},
      {"doctor", {"doctor " + scene}},
      {"info", {"info", "info " + run}},
      {"config", {"config", "config --list", "config explain loss", "config diff fast"}},
      {"selftest", {"selftest --device cpu"}}};
  const auto found = calls.find(verb);
  return found == calls.end() ? std::vector<std::string>() : found->second;
}

// With an answer, which may go to a file, on standard error, and else on standard output.
TEST_F(VerbList, EachEndsWithTheCommandThatOneMayWantNext) {
  ASSERT_EQ(train("run").code, 0);
  write_fake_colmap(path(""));
  write_bytes(path("e.toml"),
              "output = '" + text("e") + "'\nscenes = ['" + text("scene") +
                  "']\nset = {train.iterations = 5, train.device = 'cpu', dataset.eval = true, "
                  "dataset.test_every = 3}\n");
  ASSERT_EQ(run("georef " + text("scene") + " --origin 8.5,47.4,400").code, 0);
  const std::regex command("[a-z ]+: (gemsplat|xdg-open|ls|less) .*");
  for (const std::string& verb : names()) {
    const std::vector<std::string> calls = calls_of(verb, text(""));
    EXPECT_FALSE(calls.empty()) << "add a call of " << verb << " here";
    for (const std::string& call : calls) {
      const bool is_server = verb == "view" || verb == "studio";
      if (is_server && !can_view()) continue;
      const Outcome outcome = run(call, is_server ? "timeout -s INT 2 " : "");
      const std::vector<std::string> out = lines_of(outcome.out), err = lines_of(outcome.err);
      const bool is_behind_out = !out.empty() && std::regex_match(out.back(), command);
      const bool is_behind_err = !err.empty() && std::regex_match(err.back(), command);
      EXPECT_NE(is_behind_out, is_behind_err) << call << "\n" << outcome.out << outcome.err;
    }
  }
  EXPECT_EQ(run("config -q").err, "");
  EXPECT_EQ(count_lines(run("edit -q --recenter " + text("run")).out, "gemsplat"), 0);
}

TEST_F(VerbList, AFolderInPlaceOfACommandIsTrainedOnAndGoesOn) {
  write_scene(path("scene"));
  const Outcome first = run(text("scene") + kTrain);
  ASSERT_EQ(first.code, 0) << first.err;
  EXPECT_THAT(first.out, HasSubstr("look at it: gemsplat view " + text("scene-run")));
  EXPECT_THAT(run(text("scene") + kTrain).err, HasSubstr("is finished"));
  EXPECT_THAT(run(text("nowhere")).err, HasSubstr("there is no command"));
}

}  // namespace
}  // namespace gs
