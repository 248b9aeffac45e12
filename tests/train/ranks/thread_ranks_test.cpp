// SPDX-License-Identifier: Apache-2.0
// How ranks talk, and what happens when one of them fails; and which rank has which row.
#include "gs_train/ranks/thread_ranks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <stdexcept>
#include <thread>

#include "gs_core/error.h"
#include "gs_train/ranks/deal.h"
#include "tests/support/error_of.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using Seconds = ThreadRanks::Seconds;

constexpr Seconds kLong{30}, kShort{0.2};

Message message_with(int number) { return {std::byte(number)}; }

TEST(Deal, LocalAndGlobalRowsAreInverse) {
  for (const int ranks : {1, 2, 3, 4})
    for (const std::size_t rows : {0, 1, 6, 7, 8, 27, 28, 29, 100}) {
      const Deal deal{ranks, rows, 7};
      std::vector<std::size_t> next(std::size_t(ranks), 0);  // local rows are in global order
      for (std::size_t row = 0; row < rows; ++row) {
        const int rank = deal.rank_of(row);
        ASSERT_EQ(deal.local_of(row), next[std::size_t(rank)]++) << ranks << " " << rows;
        ASSERT_EQ(deal.global_of(rank, deal.local_of(row)), row) << ranks << " " << rows;
      }
      for (int rank = 0; rank < ranks; ++rank)
        EXPECT_EQ(deal.count_of(rank), next[std::size_t(rank)]) << ranks << " " << rows;
    }
}

TEST(Deal, OfOneRankIsTheModel) {
  const Deal deal{1, 10000};
  EXPECT_EQ(deal.count_of(0), 10000u);
  EXPECT_EQ(deal.local_of(9999), 9999u);
}

TEST(ThreadRanks, ExchangeMessagesManyTimes) {
  ThreadRanks ranks(3, kLong);
  std::atomic<int> wrong{0};
  ranks.run([&](Communicator& communicator) {
    for (int round = 0; round < 50; ++round) {
      std::vector<Message> outgoing;
      for (int to = 0; to < 3; ++to)
        outgoing.push_back(message_with(round + 10 * communicator.rank() + 3 * to));
      const std::vector<Message> incoming = communicator.exchange(std::move(outgoing));
      for (int from = 0; from < 3; ++from)
        if (incoming[std::size_t(from)] !=
            message_with(round + 10 * from + 3 * communicator.rank()))
          ++wrong;
    }
  });
  EXPECT_EQ(wrong, 0);
}

TEST(ThreadRanks, GatherInTheOrderOfRanks) {
  ThreadRanks ranks(4, kLong);
  std::atomic<int> right{0};
  ranks.run([&](Communicator& communicator) {
    const std::vector<Message> all = communicator.all_gather(message_with(communicator.rank()));
    right += all == std::vector{message_with(0), message_with(1), message_with(2), message_with(3)};
  });
  EXPECT_EQ(right, 4);
}

TEST(ThreadRanks, WaitForEachOtherAtABarrier) {
  ThreadRanks ranks(3, kLong);
  std::atomic<int> before{0}, seen{0};
  ranks.run([&](Communicator& communicator) {
    if (communicator.rank() == 1) std::this_thread::sleep_for(Seconds(0.05));
    ++before;
    communicator.barrier();
    seen += before;
  });
  EXPECT_EQ(seen, 9);
}

TEST(ThreadRanks, EndWithTheErrorOfTheOneThatThrows) {
  ThreadRanks ranks(3, kLong);
  try {
    ranks.run([&](Communicator& communicator) {
      if (communicator.rank() == 2)
        throw Error("the photo a.jpg is damaged", ExitCode::out_of_memory);
      communicator.barrier();
    });
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "rank 2: the photo a.jpg is damaged");
    EXPECT_EQ(error.code(), ExitCode::out_of_memory);
  }
  EXPECT_FALSE(ranks.has_lost_rank());
  ranks.run([](Communicator& communicator) { communicator.barrier(); });  // can run again
}

TEST(ThreadRanks, CallABrokenPromiseABug) {
  ThreadRanks ranks(2, kLong);
  EXPECT_THROW(ranks.run([](Communicator& communicator) {
    if (communicator.rank() == 1) GS_CHECK(false);
    communicator.barrier();
  }),
               std::logic_error);
}

TEST(ThreadRanks, NeverWaitForOneThatHasEnded) {
  ThreadRanks ranks(2, kLong);
  EXPECT_THROW(ranks.run([](Communicator& communicator) {
    if (communicator.rank() == 0) communicator.barrier();
  }),
               std::logic_error);
}

// The thread that hangs ends when the test lets it go; until then it is left behind.
TEST(ThreadRanks, EndWithinTheDeadlineWhenOneHangs) {
  ThreadRanks ranks(3, kShort);
  const auto let_go = std::make_shared<std::promise<void>>();
  const auto ended = std::make_shared<std::promise<void>>();
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_THAT(
      error_of([&] {
        ranks.run([let_go, ended](Communicator& communicator) {
          if (communicator.rank() == 1) {
            let_go->get_future().wait();
            ended->set_value();
          }
          communicator.barrier();
        });
      }),
      AllOf(HasSubstr("rank 1: no sign of life for 0.2 s"), HasSubstr("train.rank_deadline")));
  EXPECT_LT(Seconds(std::chrono::steady_clock::now() - begin), 20 * kShort);
  EXPECT_TRUE(ranks.has_lost_rank());
  let_go->set_value();
  ended->get_future().wait();
}

// Also one that all others have no reason to wait for.
TEST(ThreadRanks, EndWhenOneHangsAfterItsLastCall) {
  ThreadRanks ranks(2, kShort);
  const auto let_go = std::make_shared<std::promise<void>>();
  EXPECT_THAT(error_of([&] {
                ranks.run([let_go](Communicator& communicator) {
                  communicator.barrier();
                  if (communicator.rank() == 0) let_go->get_future().wait();
                });
              }),
              HasSubstr("rank 0: no sign of life"));
  let_go->set_value();
}

TEST(ThreadRanks, MayBeSlowerThanTheDeadlineWhileTheyShowSignsOfLife) {
  ThreadRanks ranks(2, Seconds(1));
  ranks.run([](Communicator& communicator) {
    if (communicator.rank() == 0)
      for (int i = 0; i < 15; ++i) {
        std::this_thread::sleep_for(Seconds(0.1));
        communicator.sign_of_life();
      }
    communicator.barrier();
  });
}

}  // namespace
}  // namespace gs
