// SPDX-License-Identifier: Apache-2.0
// The recipe "a verb" of docs/develop/extending.md.
#include <gtest/gtest.h>

#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"

// [recipe]
#include <CLI/CLI.hpp>
#include <iostream>

#include "apps/cli/verbs.h"
#include "gs_model/formats/formats.h"

namespace gs {
namespace {

struct CountCommand {
  std::string model;
};

void count(const CountCommand& command) {
  std::cout << read_model(command.model).gaussians.count() << " Gaussians\n";
}

}  // namespace

void add_count(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand("count", "Print the number of Gaussians of a model");
  const auto command = std::make_shared<CountCommand>();
  verb.add_option("model", command->model, "a file of trained Gaussians")->required();
  verb.callback([command] { count(*command); });
}

}  // namespace gs
// [end]

namespace gs {
namespace {

TEST(RecipeVerb, PrintsTheNumberOfGaussians) {
  const TempFolder folder;
  const std::string file = (folder.path() / "model.ply").string();
  write_model(file, random_model(7, 1));
  CLI::App program;
  add_count(program);
  testing::internal::CaptureStdout();
  program.parse("count " + file);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "7 Gaussians\n");
}

}  // namespace
}  // namespace gs
