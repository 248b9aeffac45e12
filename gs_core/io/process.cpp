// SPDX-License-Identifier: Apache-2.0
#include "gs_core/io/process.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>
#include <sys/wait.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string_view>

#include "gs_core/error.h"

extern char** environ;

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr int kCannotStart = 127;  // exit code of a shell in that case

std::vector<char*> pointers_to(const std::vector<std::string>& texts) {
  std::vector<char*> result;
  for (const std::string& text : texts) result.push_back(const_cast<char*>(text.c_str()));
  result.push_back(nullptr);
  return result;
}

std::vector<std::string> environment_with(const std::vector<std::string>& variables) {
  std::vector<std::string> all = variables;
  for (char** variable = environ; *variable; ++variable) all.push_back(*variable);
  return all;
}

[[noreturn]] void cannot_start(const std::string& program, int error) {
  throw Error(fmt::format("cannot start {}: {}; check that it is a program that runs here", program,
                          std::strerror(error)));
}

// All that the child needs between fork and exec, where it may not allocate memory.
struct Start {
  const char* program;
  char* const* arguments;
  char* const* environment;
  int output, trouble;  // `trouble`: a pipe that exec closes, or that gets the number of its error
  bool is_detached;
  pid_t parent;
};

// In the child: only calls that POSIX allows between fork and exec.
[[noreturn]] void become(const Start& start) {
  if (start.is_detached) {
    ::setsid();
  } else {
    ::setpgid(0, 0);
#ifdef __linux__
    ::prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (::getppid() != start.parent) ::_exit(kCannotStart);  // the parent died before that call
#endif
  }
  const int nothing = ::open("/dev/null", O_RDWR);
  const int output = start.output >= 0 ? start.output : nothing;
  ::dup2(nothing, STDIN_FILENO);
  ::dup2(output, STDOUT_FILENO);
  ::dup2(output, STDERR_FILENO);
  if (nothing > STDERR_FILENO) ::close(nothing);
  ::execve(start.program, start.arguments, start.environment);
  const int error = errno;
  [[maybe_unused]] const auto written = ::write(start.trouble, &error, sizeof error);
  ::_exit(kCannotStart);
}

ProcessEnd end_of(int status) {
  if (WIFSIGNALED(status)) return {0, WTERMSIG(status)};
  return {WEXITSTATUS(status), 0};
}

// The error of the child's exec; 0 after success, which closes the pipe.
int error_from(int pipe) {
  int error = 0;
  ssize_t bytes = 0;
  do {
    bytes = ::read(pipe, &error, sizeof error);
  } while (bytes < 0 && errno == EINTR);
  return bytes == ssize_t(sizeof error) ? error : 0;
}

}  // namespace

Descriptor open_log(const fs::path& file) {
  Descriptor log(::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
  if (log < 0)
    throw Error(fmt::format("cannot write {}: {}; write to a folder that you may change",
                            file.string(), std::strerror(errno)));
  return log;
}

std::optional<fs::path> find_program(const std::string& name) {
  const auto runs = [](const fs::path& file) {
    std::error_code ignored;
    return fs::is_regular_file(file, ignored) && ::access(file.c_str(), X_OK) == 0;
  };
  if (name.find('/') != name.npos) return runs(name) ? std::optional<fs::path>(name) : std::nullopt;
  const char* variable = std::getenv("PATH");
  std::string_view folders = variable ? variable : "/usr/local/bin:/usr/bin:/bin";
  while (!folders.empty()) {
    const std::size_t length = std::min(folders.find(':'), folders.size());
    const fs::path file = fs::path(folders.substr(0, length)) / name;
    if (!name.empty() && runs(file)) return file;
    folders.remove_prefix(std::min(length + 1, folders.size()));
  }
  return std::nullopt;
}

fs::path own_program() { return fs::read_symlink("/proc/self/exe"); }

pid_t start_child(const std::vector<std::string>& arguments, const ChildOptions& options) {
  const std::string& name = arguments.at(0);
  const std::string program = find_program(name).value_or(name).string();
  const std::vector<std::string> environment = environment_with(options.variables);
  const std::vector<char*> argument_pointers = pointers_to(arguments);
  const std::vector<char*> environment_pointers = pointers_to(environment);
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) cannot_start(name, errno);
  const Descriptor trouble(ends[0]);
  Descriptor trouble_of_child(ends[1]);
  const Start start{program.c_str(), argument_pointers.data(), environment_pointers.data(),
                    options.output,  trouble_of_child,         options.is_detached,
                    ::getpid()};
  const pid_t child = ::fork();
  if (child == 0) become(start);
  if (child < 0) cannot_start(name, errno);
  trouble_of_child.close();
  if (const int error = error_from(trouble)) {
    wait_for_child(child);
    cannot_start(name, error);
  }
  return child;
}

ProcessEnd wait_for_child(pid_t child) {
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return end_of(status);
}

std::optional<ChildEnd> ended_child() {
  int status = 0;
  const pid_t child = ::waitpid(-1, &status, WNOHANG);
  if (child <= 0) return std::nullopt;
  return ChildEnd{child, end_of(status)};
}

}  // namespace gs
