// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/processes/subprocess.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "gs_core/error.h"
#include "gs_core/system/processes/signals.h"

namespace gs {
namespace {

/// While it lives, a SIGINT or SIGTERM of ours goes to the child's process group: the first as
/// SIGTERM, later ones as SIGKILL. The child has a process group of its own, so that Ctrl-C in the
/// terminal reaches it this way only.
class SignalsToChild {
 public:
  void set_child(pid_t child) {
    child_ = child;
    if (received_ && child > 0) ::kill(-child, SIGTERM);  // it came before there was a child
  }
  bool received() const { return received_ > 0; }

 private:
  static void forward(int) {
    const int before = errno;
    if (child_ > 0) ::kill(-pid_t(child_), received_ ? SIGKILL : SIGTERM);
    received_ = 1;
    errno = before;
  }

  static inline volatile sig_atomic_t child_ = 0, received_ = 0;
  struct Start {
    Start() {
      child_ = 0;
      received_ = 0;
    }
  } start_;  // before the handlers, which read both
  SignalHandlers handlers_{forward, SignalHandlers::Calls::all};
};

// Qt looks for a display unless it is told that there is none.
std::vector<std::string> added_variables() {
  if (std::getenv("QT_QPA_PLATFORM")) return {};
  return {"QT_QPA_PLATFORM=offscreen"};
}

// A full disk costs the rest of the log, and not the work.
void append(int log, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(log, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return;
    bytes.remove_prefix(std::size_t(written));
  }
}

// Calls `on_block` with all that comes until every writer has closed its end.
template <class OnBlock>
void read_blocks(int input, const OnBlock& on_block) {
  char block[4096];
  while (true) {
    const ssize_t bytes = ::read(input, block, sizeof block);
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes <= 0) return;
    on_block(std::string_view(block, std::size_t(bytes)));
  }
}

// Passes the output on: bytes to `log`, unless it is negative, and lines to `on_line`.
void pass_on(int input, int log, const LineVisitor& on_line) {
  std::string line;
  read_blocks(input, [&](std::string_view block) {
    if (log >= 0) append(log, block);
    for (const char c : block) {
      if (c != '\n') {
        line += c;
      } else {
        on_line(line);
        line.clear();
      }
    }
  });
  if (!line.empty()) on_line(line);
}

}  // namespace

ProcessEnd run_process(const std::vector<std::string>& arguments, const std::filesystem::path& log,
                       const LineVisitor& on_line) {
  const Descriptor file = log.empty() ? Descriptor(-1) : open_log(log);
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0)
    throw Error(fmt::format("cannot start {}: {}; end other programs", arguments.at(0),
                            std::strerror(errno)));
  const Descriptor input(ends[0]);
  Descriptor output(ends[1]);

  SignalsToChild signals;
  const pid_t child = start_child(arguments, {.output = output, .variables = added_variables()});
  signals.set_child(child);
  output.close();
  try {
    pass_on(input, file, on_line);
  } catch (...) {  // nobody reads on: the child must not stay
    ::kill(-child, SIGKILL);
    wait_for_child(child);
    throw;
  }
  const ProcessEnd end = wait_for_child(child);
  signals.set_child(0);
  if (signals.received())
    throw Error(fmt::format("stopped by a signal while {} ran", arguments[0]),
                ExitCode::interrupted);
  return end;
}

}  // namespace gs
