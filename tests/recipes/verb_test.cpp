// SPDX-License-Identifier: Apache-2.0
// The recipe "a verb" of docs/develop/extending.md.
#include <gmock/gmock.h>

#include <CLI/CLI.hpp>

#include "apps/cli/manual/man_page.h"
#include "apps/cli/manual/reference_page.h"
#include "apps/cli/run_verb.h"
#include "gs_app/jobs/keywords.h"
#include "gs_core/error.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"

// [recipe]
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/text.h"
#include "gs_model/formats/formats.h"

namespace gs {
namespace {

struct CountJob : JobSettings {
  std::string model;
};

void visit_options(CountJob& job, OptionList& option) {
  option("model", job.model, "a file of trained Gaussians").takes("FILE").required();
}

Outcome run(const CountJob& job, JobEvents&) {
  const std::size_t count = read_model(job.model).gaussians.count();
  return {std::to_string(count) + " Gaussians\n",
          {{"gaussians", count}},
          {{"look at it", "gemsplat view " + shell_word(job.model)}}};
}

}  // namespace

Verb count_verb() {
  return verb_of<CountJob>("count", VerbGroup::check, "Print the number of Gaussians of a model",
                           {"count model.ply"});
}

}  // namespace gs
// [end]

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string output_of(const std::string& command) {
  CLI::App program;
  add_verb(program, count_verb());
  testing::internal::CaptureStdout();
  program.parse(command);
  return testing::internal::GetCapturedStdout();
}

TEST(RecipeVerb, PrintsTheNumberOfGaussiansAsTextAndAsJson) {
  const TempFolder folder;
  const std::string file = (folder.path() / "model.ply").string();
  write_model(file, random_model(7, 1));
  EXPECT_EQ(output_of("count " + file), "7 Gaussians\nlook at it: gemsplat view " + file + "\n");
  EXPECT_THAT(output_of("count --json " + file), StartsWith("{\n  \"gaussians\": 7,\n"));
}

// The module of Python makes a function of each row of verbs() by these.
TEST(RecipeVerb, ItsListIsItsKeywordsInPython) {
  const TempFolder folder;
  const std::string file = (folder.path() / "model.ply").string();
  write_model(file, random_model(7, 1));
  const auto call = count_verb().call();
  const Json keywords = describe_keywords(call->options());
  ASSERT_EQ(keywords.size(), 1u);
  EXPECT_EQ(keywords[0]["name"], "model");
  EXPECT_EQ(keywords[0]["kind"], "text");
  EXPECT_EQ(keywords[0]["meaning"], "a file of trained Gaussians");
  EXPECT_TRUE(keywords[0]["required"]);
  EXPECT_THROW(check_whole(call->options()), UsageError);
  EXPECT_THROW(take_keywords(call->options(), {{"modle", file}}), UsageError);
  EXPECT_THROW(take_keywords(call->options(), {{"model", 5}}), UsageError);
  take_keywords(call->options(), {{"model", file}});
  check_whole(call->options());
  JobEvents events;
  EXPECT_EQ(call->work(events).json, Json({{"gaussians", 7}}));
}

TEST(RecipeVerb, ItsListIsItsManual) {
  const Command program = command_of({count_verb()});
  EXPECT_THAT(reference_page(program),
              AllOf(HasSubstr("### gemsplat count\n"), HasSubstr("| `model FILE` | a file of"),
                    HasSubstr("| `--json` |")));
  EXPECT_THAT(man_page(program.verbs.front(), "2026-01-01"),
              AllOf(HasSubstr("gemsplat count model.ply"), HasSubstr("\\fB\\-\\-json\\fR")));
}

}  // namespace
}  // namespace gs
