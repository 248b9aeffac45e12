// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/processes/signals.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>

#include "gs_core/error.h"

namespace gs {

namespace {

constexpr std::int64_t kOneWish = 1000;  // ms

std::int64_t now() {
  timespec time{};
  ::clock_gettime(CLOCK_MONOTONIC, &time);
  return 1000 * std::int64_t(time.tv_sec) + time.tv_nsec / 1'000'000 + 1;
}

}  // namespace

void SignalHandlers::dispatch(int signal) {
  const int error = errno;
  if (SignalHandlers* const handlers = current_) handlers->receive(signal);
  errno = error;
}

void SignalHandlers::receive(int signal) {
  std::int64_t none = 0;
  const std::int64_t time = now();
  if (first_.compare_exchange_strong(none, time)) return handler_(signal);
  if (signal == SIGHUP || time - first_ < kOneWish) return;
  if (calls_ == Calls::all) return handler_(signal);
  std::signal(signal, SIG_DFL);
  ::raise(signal);  // takes effect when this handler has returned
}

SignalHandlers::SignalHandlers(void (*handler)(int), Calls calls)
    : handler_(handler), calls_(calls), before_(current_.exchange(this)) {
  struct sigaction action {};
  action.sa_handler = dispatch;
  action.sa_flags = SA_RESTART;
  for (std::size_t i = 0; i < kStopSignals.size(); ++i) {
    sigaction(kStopSignals[i], nullptr, &old_[i]);
    const bool is_ignored = kStopSignals[i] == SIGHUP && old_[i].sa_handler == SIG_IGN;
    if (!is_ignored) sigaction(kStopSignals[i], &action, nullptr);
  }
}

SignalHandlers::~SignalHandlers() {
  for (std::size_t i = 0; i < kStopSignals.size(); ++i)
    sigaction(kStopSignals[i], &old_[i], nullptr);
  current_ = before_;
}

void LastWords::say(int signal) {
  if (const char* const line = line_) {
    [[maybe_unused]] const auto written = ::write(STDERR_FILENO, line, std::strlen(line));
  }
  std::signal(signal, SIG_DFL);
  ::raise(signal);  // takes effect when this handler has returned
}

SignalWait::Pipe::Pipe() {
  if (::pipe2(ends_, O_CLOEXEC) != 0)
    throw Error("cannot wait for signals: too many files are open; end other programs");
}

SignalWait::Pipe::~Pipe() {
  ::close(ends_[0]);
  ::close(ends_[1]);
}

SignalWait::SignalWait() = default;
SignalWait::~SignalWait() = default;

void SignalWait::wait() {
  char byte = 0;
  while (::read(ends_[0], &byte, 1) < 0 && errno == EINTR) {
  }
}

void SignalWait::wake(int) {
  const int error = errno;
  [[maybe_unused]] const auto written = ::write(ends_[1], "", 1);
  errno = error;
}

}  // namespace gs
