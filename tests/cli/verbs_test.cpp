// SPDX-License-Identifier: Apache-2.0
// What all verbs have in common, because it comes from their lists: help, JSON, progress, the page
// of commands. And what a new user types.
#include <gmock/gmock.h>

#include <regex>
#include <sstream>

#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

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
    const std::regex verb("^  ([a-z]+) .*");
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
  EXPECT_EQ(names().size(), 17u);
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
  EXPECT_THAT(first.err, HasSubstr("the run goes to " + text("scene-run") + "; -o OUT names"));
  EXPECT_TRUE(fs::exists(path("scene-run/results.json")));
  EXPECT_THAT(run("train " + text("scene") + kTrain).err, HasSubstr("--resume goes on with it"));
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
