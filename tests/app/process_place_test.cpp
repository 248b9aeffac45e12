// SPDX-License-Identifier: Apache-2.0
// Which process of a run a process is, and which GPUs it has.
#include "gs_app/run/process_place.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "tests/support/error_of.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::optional<ProcessPlace> place_by(const std::map<std::string, std::string>& variables) {
  return process_place([&](const char* name) -> const char* {
    const auto found = variables.find(name);
    return found == variables.end() ? nullptr : found->second.c_str();
  });
}

TEST(ProcessPlaces, AreThoseOfWhoeverHasStartedThem) {
  const auto srun = place_by({{"SLURM_PROCID", "1"},
                              {"SLURM_STEP_NUM_TASKS", "3"},
                              {"SLURM_LOCALID", "0"},
                              {"SLURM_JOB_ID", "17"},
                              {"SLURM_STEP_ID", "2"}});
  ASSERT_TRUE(srun);
  EXPECT_EQ(srun->rank, 1);
  EXPECT_EQ(srun->count, 3);
  EXPECT_EQ(srun->on_machine, 0);
  EXPECT_EQ(srun->job, "slurm-17.2");
  const auto mpirun = place_by({{"OMPI_COMM_WORLD_RANK", "3"},
                                {"OMPI_COMM_WORLD_SIZE", "4"},
                                {"OMPI_COMM_WORLD_LOCAL_RANK", "1"},
                                {"PMIX_NAMESPACE", "a/b@1"}});
  ASSERT_TRUE(mpirun);
  EXPECT_EQ(mpirun->on_machine, 1);
  EXPECT_EQ(mpirun->job, "mpi-a_b_1");
}

TEST(ProcessPlaces, AreNoneOfAProcessThatIsAlone) {
  EXPECT_FALSE(place_by({}));
  EXPECT_FALSE(place_by({{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "4"}}));  // a batch script
  EXPECT_FALSE(place_by({{"SLURM_PROCID", "0"}, {"SLURM_STEP_NUM_TASKS", "1"}}));
}

TEST(ProcessPlaces, ThatContradictThemselvesAreRefused) {
  EXPECT_THAT(error_of([] {
                place_by({{"PMI_RANK", "2"}, {"PMI_SIZE", "2"}});
              }),
              HasSubstr("process 2 (PMI_RANK) of 2 (PMI_SIZE)"));
  EXPECT_THAT(error_of([] {
                place_by({{"PMI_RANK", "-1"}, {"PMI_SIZE", "2"}});
              }),
              HasSubstr("PMI_RANK is -1"));
}

ProcessPlace started(int rank, std::optional<int> on_machine = {}) {
  ProcessPlace place;
  place.rank = rank;
  place.count = 8;
  place.on_machine = on_machine;
  return place;
}

TEST(GpusOfProcesses, FollowEachOtherOnAMachine) {
  EXPECT_EQ(first_gpu_of(started(6, 2), 0, 1, 4), 2);  // the third process of the second machine
  EXPECT_EQ(first_gpu_of(started(6, 2), 1, 1, 4), 3);  // with --device cuda:1
  EXPECT_EQ(first_gpu_of(started(3), 0, 1, 4), 3);     // nobody says where it is
  EXPECT_EQ(first_gpu_of(started(3, 1), 0, 2, 4), 2);  // with --gpus 2
}

TEST(GpusOfProcesses, AreThoseThatTheStarterShows) {
  EXPECT_EQ(first_gpu_of(started(6, 2), 0, 1, 1), 0);  // srun --gpus-per-task=1
  EXPECT_EQ(first_gpu_of(started(6, 2), 0, 2, 2), 0);
}

TEST(GpusOfProcesses, ThatAreTooFewAreRefused) {
  EXPECT_THAT(error_of([] { first_gpu_of(started(2), 0, 1, 2); }),
              AllOf(HasSubstr("process 2 needs the GPU cuda:2"), HasSubstr("it sees 2")));
  EXPECT_THAT(error_of([] { first_gpu_of(started(1), 0, 2, 3); }), HasSubstr("cuda:3"));
}

}  // namespace
}  // namespace gs
