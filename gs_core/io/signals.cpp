// SPDX-License-Identifier: Apache-2.0
#include "gs_core/io/signals.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>

#include "gs_core/error.h"

namespace gs {

SignalHandlers::SignalHandlers(void (*handler)(int), Calls calls) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = SA_RESTART;
  if (calls == Calls::first) action.sa_flags |= int(SA_RESETHAND);
  for (std::size_t i = 0; i < kStopSignals.size(); ++i) {
    sigaction(kStopSignals[i], nullptr, &old_[i]);
    const bool is_ignored = kStopSignals[i] == SIGHUP && old_[i].sa_handler == SIG_IGN;
    if (!is_ignored) sigaction(kStopSignals[i], &action, nullptr);
  }
}

SignalHandlers::~SignalHandlers() {
  for (std::size_t i = 0; i < kStopSignals.size(); ++i)
    sigaction(kStopSignals[i], &old_[i], nullptr);
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
