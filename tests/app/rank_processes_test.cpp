// SPDX-License-Identifier: Apache-2.0
// Which rank a process is, who may join a run, and whether both have the same scene.
#include "gs_app/ranks/rank_processes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <thread>

#include "gs_app/ranks/shared_scene.h"
#include "gs_core/error.h"
#include "gs_core/version.h"
#include "gs_train/ranks/peer_ranks.h"
#include "tests/support/error_of.h"
#include "tests/support/small_scene.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::optional<RankPlace> place_by(const std::map<std::string, std::string>& variables) {
  return rank_place([&](const char* name) -> const char* {
    const auto found = variables.find(name);
    return found == variables.end() ? nullptr : found->second.c_str();
  });
}

TEST(RankPlaces, AreThoseOfWhoeverHasStartedThem) {
  const auto ours = place_by(
      {{"GS_RANK", "2"}, {"GS_RANKS", "4"}, {"GS_RANK_PORT", "4321"}, {"GS_RANK_NONCE", "abc"}});
  ASSERT_TRUE(ours && ours->is_ours);
  EXPECT_EQ(ours->rank, 2);
  EXPECT_EQ(ours->count, 4);
  EXPECT_EQ(ours->port, 4321);
  EXPECT_EQ(ours->nonce, "abc");
  const auto srun = place_by({{"SLURM_PROCID", "1"},
                              {"SLURM_STEP_NUM_TASKS", "3"},
                              {"SLURM_LOCALID", "0"},
                              {"SLURM_JOB_ID", "17"},
                              {"SLURM_STEP_ID", "2"}});
  ASSERT_TRUE(srun && !srun->is_ours);
  EXPECT_EQ(srun->rank, 1);
  EXPECT_EQ(srun->on_machine, 0);
  EXPECT_EQ(srun->meeting_file, ".gemsplat-ranks-slurm-17.2");
  const auto mpirun = place_by({{"OMPI_COMM_WORLD_RANK", "3"},
                                {"OMPI_COMM_WORLD_SIZE", "4"},
                                {"OMPI_COMM_WORLD_LOCAL_RANK", "1"},
                                {"PMIX_NAMESPACE", "a/b@1"}});
  ASSERT_TRUE(mpirun);
  EXPECT_EQ(mpirun->on_machine, 1);
  EXPECT_EQ(mpirun->meeting_file, ".gemsplat-ranks-mpi-a_b_1");
}

TEST(RankPlaces, AreNoneOfAProcessThatIsAlone) {
  EXPECT_FALSE(place_by({}));
  EXPECT_FALSE(place_by({{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "4"}}));  // a batch script
  EXPECT_FALSE(place_by({{"SLURM_PROCID", "0"}, {"SLURM_STEP_NUM_TASKS", "1"}}));
}

TEST(RankPlaces, ThatContradictThemselvesAreRefused) {
  EXPECT_THAT(error_of([] {
                place_by({{"PMI_RANK", "2"}, {"PMI_SIZE", "2"}});
              }),
              HasSubstr("rank 2 (PMI_RANK) of 2 (PMI_SIZE)"));
  EXPECT_THAT(error_of([] {
                place_by({{"PMI_RANK", "-1"}, {"PMI_SIZE", "2"}});
              }),
              HasSubstr("PMI_RANK is -1"));
}

RankPlace started(int rank, bool is_ours, std::optional<int> on_machine = {}) {
  RankPlace place;
  place.rank = rank;
  place.count = 8;
  place.is_ours = is_ours;
  place.on_machine = on_machine;
  return place;
}

TEST(GpusOfRanks, FollowEachOtherOnAMachine) {
  EXPECT_EQ(gpu_of(started(2, true), 0, 4), 2);      // rank 0 has started it
  EXPECT_EQ(gpu_of(started(2, true), 1, 4), 3);      // with --device cuda:1
  EXPECT_EQ(gpu_of(started(6, false, 2), 0, 4), 2);  // the third rank of the second machine
  EXPECT_EQ(gpu_of(started(3, false), 0, 4), 3);     // nobody says where it is
}

TEST(GpusOfRanks, AreTheOnlyOneThatTheStarterShows) {
  EXPECT_EQ(gpu_of(started(6, false, 2), 0, 1), 0);  // srun --gpus-per-task=1
}

TEST(GpusOfRanks, ThatAreTooFewAreRefused) {
  EXPECT_THAT(error_of([] { gpu_of(started(2, true), 0, 2); }),
              AllOf(HasSubstr("rank 2 needs the GPU cuda:2"), HasSubstr("sees 2 of them")));
  EXPECT_THAT(error_of([] { gpu_of(started(1, true), 0, 1); }), HasSubstr("sees only cuda:0"));
  EXPECT_THAT(error_of([] { gpu_of(started(6, false, 2), 2, 4); }),
              HasSubstr("rank 6 needs the GPU cuda:4"));
}

/// A run of three ranks that wait for each other in a folder.
class Meeting : public ::testing::Test {
 protected:
  Meeting() {
    place_.count = 3;
    place_.meeting_file = (folder_.path() / "meeting").string();
    processes_.emplace(3, "", place_);
    std::ifstream(place_.meeting_file) >> host_ >> port_ >> nonce_;
  }
  /// Connects, says hello, and stays.
  void come(const RankHello& hello) {
    guests_.push_back(connect_to_peer("127.0.0.1", port_, PeerSocket::Seconds(10)));
    guests_.back().send(std::uint32_t(RankFrame::hello), message_of(hello),
                        PeerSocket::Seconds(10));
  }

  TempFolder folder_;
  RankPlace place_;
  std::optional<RankProcesses> processes_;
  std::string host_, nonce_;
  int port_ = 0;
  std::vector<PeerSocket> guests_;
};

TEST_F(Meeting, TakesTheRanksOfTheRunAlone) {
  come({"a wrong word", kVersion, 1});
  come({nonce_, kVersion, 3});  // there is no such rank
  come({nonce_, kVersion, 2});
  come({nonce_, kVersion, 1});
  std::vector<PeerSocket> peers = processes_->meet();
  ASSERT_EQ(peers.size(), 2u);
  peers[0].send(7, {}, PeerSocket::Seconds(10));
  EXPECT_EQ(guests_[3].receive(PeerSocket::Seconds(10)).kind, 7u);
  EXPECT_THROW(guests_[0].receive(PeerSocket::Seconds(10)), PeerLost);
}

TEST_F(Meeting, RefusesAnotherVersion) {
  come({nonce_, "0.0.1", 2});
  EXPECT_THAT(error_of([&] { processes_->meet(); }),
              AllOf(HasSubstr("rank 2 is gemsplat 0.0.1"), HasSubstr(kVersion)));
}

TEST_F(Meeting, RefusesTheSameRankTwice) {
  come({nonce_, kVersion, 1});
  come({nonce_, kVersion, 1});
  EXPECT_THAT(error_of([&] { processes_->meet(); }), HasSubstr("two processes say that they are"));
}

TEST_F(Meeting, RemovesItsFile) {
  EXPECT_TRUE(std::filesystem::exists(place_.meeting_file));
  processes_.reset();
  EXPECT_FALSE(std::filesystem::exists(place_.meeting_file));
}

TEST(SharedScenes, TellEachRankTheSameViews) {
  Scene scene = small_scene();
  Config config;
  config.train.seed = 77;
  scene.train_views[1].camera.fx = 31;  // as another run has refined it
  scene.train_views[1].exposure = Vec3f(1.5f, 1, 1);
  const SharedScene shared =
      shared_scene_in(message_of(shared_scene(config, scene, "of its files")));
  EXPECT_EQ(shared.config.train.seed, 77u);
  EXPECT_EQ(shared.scene_hash, "of its files");
  Scene loaded = small_scene();
  make_same(loaded, shared);
  EXPECT_EQ(loaded.train_views[1].camera.fx, 31);
  EXPECT_EQ(loaded.train_views[1].exposure.x, 1.5f);
}

TEST(SharedScenes, OfOtherPhotosAreRefused) {
  const SharedScene shared = shared_scene({}, small_scene(), "");
  Scene fewer = small_scene();
  fewer.train_views.pop_back();
  EXPECT_THAT(error_of([&] { make_same(fewer, shared); }), HasSubstr("has other photos here"));
  Scene other = small_scene();
  other.train_views[0].name = "another";
  EXPECT_THAT(error_of([&] { make_same(other, shared); }), HasSubstr("has other photos here"));
}

}  // namespace
}  // namespace gs
