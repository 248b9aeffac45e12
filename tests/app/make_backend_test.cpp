// SPDX-License-Identifier: Apache-2.0
// Which backend the settings of a run ask for; those of GPUs, as far as no GPU is needed.
#include "gs_app/run/make_backend.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "tests/support/error_of.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TrainConfig with_gpus(const std::string& gpus, bool is_new, TrainConfig train = {}) {
  take_gpus(gpus, is_new, train);
  return train;
}

TEST(TakeGpus, GivesANewRunAsManyGpusAndPhotosOfAnUpdate) {
  const TrainConfig train = with_gpus("4", true);
  EXPECT_EQ(train.device, "cuda");
  EXPECT_EQ(train.ranks, 4);
  EXPECT_EQ(train.batch, 4);
}

TEST(TakeGpus, KeepsTheBatchOfARunThatGoesOnAndOneThatWasGiven) {
  EXPECT_EQ(with_gpus("4", false).batch, 1);
  TrainConfig train;
  train.batch = 6;
  train.device = "cuda:1";
  train = with_gpus("2", true, train);
  EXPECT_EQ(train.batch, 6);
  EXPECT_EQ(train.device, "cuda:1");
}

TEST(TakeGpus, TakesAllOfThem) {
  EXPECT_EQ(with_gpus("all", true).ranks, std::max(cuda_device_count(), 1));
}

TEST(TakeGpus, RefusesOtherWords) {
  for (const std::string gpus : {"0", "-1", "65", "two", "2x", "99999999999"})
    EXPECT_THAT(error_of([&] { with_gpus(gpus, true); }), HasSubstr("--gpus " + gpus)) << gpus;
}

TEST(TakeGpus, RefusesTheCpu) {
  TrainConfig train;
  train.device = "cpu";
  EXPECT_THAT(error_of([&] { with_gpus("2", true, train); }), HasSubstr("--gpus"));
}

TEST(MakeTrainingBackend, RefusesSeveralGpusOnTheCpu) {
  TrainConfig train;
  train.device = "cpu";
  train.ranks = 3;
  EXPECT_THAT(error_of([&] { make_training_backend(train); }),
              AllOf(HasSubstr("train.ranks is 3"), HasSubstr("set train.ranks=1")));
}

TEST(MakeTrainingBackend, SaysThatThereAreTooFewGpus) {
  TrainConfig train;
  train.ranks = 64;
  train.device = "cuda";
  const std::string error = error_of([&] { make_training_backend(train); });
  if (cuda_device_count() > 0)
    EXPECT_THAT(error, AllOf(HasSubstr("train.ranks is 64"), HasSubstr("set train.ranks=")));
  else
    EXPECT_THAT(error, AllOf(HasSubstr("no "), HasSubstr("--device cpu")));
}

}  // namespace
}  // namespace gs
