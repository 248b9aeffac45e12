// SPDX-License-Identifier: Apache-2.0
// On which GPUs the runs of an experiment are trained.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "gs_app/experiment/experiment_run.h"
#include "tests/support/error_of.h"

namespace gs {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

std::vector<std::string> devices_of(const std::vector<RunSlot>& slots) {
  std::vector<std::string> devices;
  for (const RunSlot& slot : slots) devices.push_back(slot.device);
  return devices;
}

TEST(ExperimentSlots, AreAsManyOnEachDeviceAsThereAreJobs) {
  EXPECT_THAT(devices_of(slots_on({}, 0, 1)), ElementsAre(""));
  EXPECT_THAT(devices_of(slots_on({"cuda:0", "cpu"}, 0, 2)),
              ElementsAre("cuda:0", "cpu", "cuda:0", "cpu"));
  EXPECT_EQ(slots_on({}, 0, 1).front().threads, 0);
  EXPECT_GE(slots_on({}, 0, 2).front().threads, 1);
}

TEST(ExperimentSlots, TakeGroupsOfGpusThatFollowEachOther) {
  const std::vector<RunSlot> slots = slots_on({"cuda:0", "cuda:1", "cuda:4", "cuda:5"}, 2, 1);
  EXPECT_THAT(devices_of(slots), ElementsAre("cuda:0", "cuda:4"));
  for (const RunSlot& slot : slots) EXPECT_EQ(slot.gpus, 2);
  EXPECT_THAT(devices_of(slots_on({}, 2, 1)), ElementsAre("cuda"));
}

TEST(ExperimentSlots, RefuseOtherGroups) {
  const auto error = [](const std::vector<std::string>& devices) {
    return error_of([&] { slots_on(devices, 2, 1); });
  };
  EXPECT_THAT(error({"cuda:0", "cuda:1", "cuda:2"}), HasSubstr("there are 3"));
  EXPECT_THAT(error({"cuda:0", "cuda:2"}), HasSubstr("cuda:2 is not the GPU after cuda:0"));
  EXPECT_THAT(error({"cpu", "cpu"}), HasSubstr("and not cpu"));
}

TEST(ExperimentSlots, BecomeFlagsOfTheRun) {
  ExperimentRun run;
  run.folder = RunFolder("/nowhere/run");
  EXPECT_THAT(::testing::PrintToString(train_command(run, {"cuda:2", 3, 2})),
              ::testing::AllOf(HasSubstr("\"--device\", \"cuda:2\""),
                               HasSubstr("\"--set\", \"train.ranks=2\""),
                               HasSubstr("\"--threads\", \"3\"")));
  EXPECT_THAT(::testing::PrintToString(train_command(run, {})), Not(HasSubstr("ranks")));
}

}  // namespace
}  // namespace gs
