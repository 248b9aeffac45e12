// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "gs_core/error.h"

namespace gs {
namespace {

constexpr int kCannotStart = 127;  // what a shell returns then

// In the child, between fork and exec: only calls that POSIX allows there. Never returns.
[[noreturn]] void become(char* const* arguments, int output, pid_t parent) {
  ::setpgid(0, 0);
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != parent) ::_exit(kCannotStart);  // it died before the line above
  const int input = ::open("/dev/null", O_RDONLY);
  ::dup2(input, STDIN_FILENO);
  ::dup2(output, STDOUT_FILENO);
  ::dup2(output, STDERR_FILENO);
  ::execv(arguments[0], arguments);
  ::_exit(kCannotStart);
}

}  // namespace

std::filesystem::path own_program() { return std::filesystem::read_symlink("/proc/self/exe"); }

pid_t start_child(const std::vector<std::string>& arguments, const std::filesystem::path& log) {
  std::vector<char*> pointers;
  for (const std::string& argument : arguments)
    pointers.push_back(const_cast<char*>(argument.c_str()));
  pointers.push_back(nullptr);
  const int output = ::open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  if (output < 0)
    throw Error(fmt::format("cannot write {}: {}; write to a folder that you may change",
                            log.string(), std::strerror(errno)));
  const pid_t parent = ::getpid(), child = ::fork();
  if (child == 0) become(pointers.data(), output, parent);
  const int error = errno;
  ::close(output);
  if (child < 0)
    throw Error(fmt::format("cannot start {}: {}; run fewer jobs at a time", arguments.at(0),
                            std::strerror(error)));
  ::setpgid(child, child);  // whoever is first
  return child;
}

std::optional<ChildEnd> ended_child() {
  int status = 0;
  const pid_t child = ::waitpid(-1, &status, WNOHANG);
  if (child <= 0) return std::nullopt;
  if (WIFSIGNALED(status)) return ChildEnd{child, {0, WTERMSIG(status)}};
  return ChildEnd{child, {WEXITSTATUS(status), 0}};
}

}  // namespace gs
