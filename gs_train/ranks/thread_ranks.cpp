// SPDX-License-Identifier: Apache-2.0
#include "gs_train/ranks/thread_ranks.h"

#include <spdlog/fmt/fmt.h>

#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <new>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "gs_core/error.h"

namespace gs {
namespace {

using Clock = std::chrono::steady_clock;

// Ends the work of a rank because another one has failed.
struct OtherRankFailed {};

struct Failure {
  int rank;
  std::exception_ptr cause;
};

enum class RankState { working, waiting, ended };

// Where the ranks of one run meet. Each thread owns it, since one that hangs outlives the run.
class Meeting {
 public:
  Meeting(int count, ThreadRanks::Seconds deadline)
      : deadline_(std::chrono::duration_cast<Clock::duration>(deadline)),
        members_(std::size_t(count), {RankState::working, Clock::now()}) {
    for (std::vector<std::vector<Message>>& board : boards_) board.resize(members_.size());
  }

  std::vector<Message> exchange(int rank, std::vector<Message> outgoing) {
    GS_CHECK(outgoing.size() == members_.size());
    std::unique_lock lock(mutex_);
    // While some ranks take messages of this round from one board, others may already put those of
    // the next round on the other board. Nobody is two rounds ahead.
    std::vector<std::vector<Message>>& board = boards_[round_ % 2];
    board[std::size_t(rank)] = std::move(outgoing);
    meet(lock, rank);
    std::vector<Message> incoming;
    for (std::vector<Message>& sent : board) incoming.push_back(std::move(sent[std::size_t(rank)]));
    return incoming;
  }

  void barrier(int rank) {
    std::unique_lock lock(mutex_);
    meet(lock, rank);
  }

  void sign_of_life(int rank) {
    const std::scoped_lock lock(mutex_);
    member(rank).sign = Clock::now();
    if (failure_) throw OtherRankFailed();
  }

  void end(int rank) {
    const std::scoped_lock lock(mutex_);
    member(rank).state = RankState::ended;
    changed_.notify_all();
  }

  // A rank ends because of its own error.
  void fail(int rank, std::exception_ptr cause) {
    const std::scoped_lock lock(mutex_);
    member(rank).state = RankState::ended;
    note_failure(rank, std::move(cause));
  }

  // Waits until all ranks have ended, apart from one that has hung. After a failure the others have
  // one more deadline to notice it.
  std::optional<Failure> wait_for_all() {
    std::unique_lock lock(mutex_);
    while (!all_ended()) {
      if (failure_ && Clock::now() > failed_at_ + deadline_) break;
      look_after_others(lock);
    }
    return failure_;
  }

  bool has_ended(int rank) {
    const std::scoped_lock lock(mutex_);
    return member(rank).state == RankState::ended;
  }

 private:
  struct Member {
    RankState state;
    Clock::time_point sign;  // of life
  };

  Member& member(int rank) { return members_[std::size_t(rank)]; }

  bool all_ended() const {
    for (std::size_t i = 0; i < members_.size(); ++i) {
      const bool has_failed = failure_ && failure_->rank == int(i);
      if (members_[i].state != RankState::ended && !has_failed) return false;
    }
    return true;
  }

  // Returns when all ranks have come here.
  void meet(std::unique_lock<std::mutex>& lock, int rank) {
    if (failure_) throw OtherRankFailed();
    const std::uint64_t round = round_;
    if (++arrived_ == members_.size()) {
      arrived_ = 0;
      ++round_;
      changed_.notify_all();
    } else {
      member(rank).state = RankState::waiting;
      while (round_ == round) {
        check_nobody_left();
        look_after_others(lock);
        if (failure_) throw OtherRankFailed();
      }
    }
    member(rank) = {RankState::working, Clock::now()};
  }

  // A rank that has ended never comes to a meeting that others wait for.
  void check_nobody_left() {
    for (std::size_t i = 0; i < members_.size(); ++i)
      if (!failure_ && members_[i].state == RankState::ended)
        note_failure(int(i), std::make_exception_ptr(std::logic_error(
                                 "internal error: it ended while other ranks waited for it")));
    if (failure_) throw OtherRankFailed();
  }

  // Waits a little for a change, then looks for a rank that has hung.
  void look_after_others(std::unique_lock<std::mutex>& lock) {
    changed_.wait_for(lock, deadline_ / 8);
    if (failure_) return;
    std::size_t oldest = members_.size();
    for (std::size_t i = 0; i < members_.size(); ++i)
      if (members_[i].state == RankState::working &&
          (oldest == members_.size() || members_[i].sign < members_[oldest].sign))
        oldest = i;
    if (oldest == members_.size() || Clock::now() < members_[oldest].sign + deadline_) return;
    note_failure(int(oldest),
                 std::make_exception_ptr(Error(
                     fmt::format("no sign of life for {:g} s, so the run ends; its last checkpoint "
                                 "stands. If the machine is only slow, raise train.rank_deadline",
                                 std::chrono::duration<double>(deadline_).count()))));
  }

  void note_failure(int rank, std::exception_ptr cause) {
    if (!failure_) {
      failure_ = Failure{rank, std::move(cause)};
      failed_at_ = Clock::now();
    }
    changed_.notify_all();
  }

  const Clock::duration deadline_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Member> members_;
  std::vector<std::vector<Message>> boards_[2];  // [sender][receiver]
  std::size_t arrived_ = 0;
  std::uint64_t round_ = 0;
  std::optional<Failure> failure_;  // the first
  Clock::time_point failed_at_;
};

class ThreadCommunicator final : public Communicator {
 public:
  ThreadCommunicator(Meeting& meeting, int rank, int count)
      : meeting_(meeting), rank_(rank), count_(count) {}
  int rank() const override { return rank_; }
  int count() const override { return count_; }
  std::vector<Message> exchange(std::vector<Message> outgoing) override {
    return meeting_.exchange(rank_, std::move(outgoing));
  }
  void barrier() override { meeting_.barrier(rank_); }
  void sign_of_life() override { meeting_.sign_of_life(rank_); }

 private:
  Meeting& meeting_;
  const int rank_, count_;
};

void work_as(int rank, int count, const std::function<void(Communicator&)>& work,
             Meeting& meeting) {
  try {
    ThreadCommunicator communicator(meeting, rank, count);
    work(communicator);
  } catch (const OtherRankFailed&) {
  } catch (...) {
    return meeting.fail(rank, std::current_exception());
  }
  meeting.end(rank);
}

[[noreturn]] void throw_as_error(const Failure& failure) {
  const auto named = [&](const std::string& what) {
    return fmt::format("rank {}: {}", failure.rank, what);
  };
  try {
    std::rethrow_exception(failure.cause);
  } catch (const Error& error) {
    throw Error(named(error.what()), error.code());
  } catch (const std::bad_alloc&) {
    throw Error(named("out of memory"), ExitCode::out_of_memory);
  } catch (const std::logic_error& error) {
    throw std::logic_error(named(error.what()));
  } catch (const std::exception& error) {
    throw Error(named(error.what()));
  }
}

}  // namespace

void ThreadRanks::run(const std::function<void(Communicator&)>& work) {
  GS_CHECK(!has_lost_rank_);
  const auto meeting = std::make_shared<Meeting>(count_, deadline_);
  std::vector<std::thread> threads;
  threads.reserve(std::size_t(count_));
  for (int rank = 0; rank < count_; ++rank) try {
      threads.emplace_back([=, count = count_] { work_as(rank, count, work, *meeting); });
    } catch (const std::system_error& error) {
      meeting->fail(rank, std::make_exception_ptr(Error(fmt::format(
                              "no thread can be started ({}); lower train.ranks", error.what()))));
      for (int missing = rank + 1; missing < count_; ++missing) meeting->end(missing);
      break;
    }
  const std::optional<Failure> failure = meeting->wait_for_all();
  for (std::size_t rank = 0; rank < threads.size(); ++rank) {
    if (meeting->has_ended(int(rank))) {
      threads[rank].join();
    } else {
      threads[rank].detach();
      has_lost_rank_ = true;
    }
  }
  if (failure) throw_as_error(*failure);
}

}  // namespace gs
