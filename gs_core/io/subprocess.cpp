// SPDX-License-Identifier: Apache-2.0
#include "gs_core/io/subprocess.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <spdlog/fmt/fmt.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "gs_core/error.h"

extern char** environ;

namespace gs {
namespace {

namespace fs = std::filesystem;

/// While it lives, SIGINT and SIGTERM of ours go to the child's process group, as SIGTERM and then as
/// SIGKILL. The child has a group of its own, so that a Ctrl-C of the terminal reaches it through here only.
class SignalsToChild {
 public:
  SignalsToChild() {
    child_ = 0;
    received_ = 0;
    struct sigaction action {};
    action.sa_handler = forward;
    sigaction(SIGINT, &action, &old_interrupt_);
    sigaction(SIGTERM, &action, &old_terminate_);
  }
  ~SignalsToChild() {
    sigaction(SIGINT, &old_interrupt_, nullptr);
    sigaction(SIGTERM, &old_terminate_, nullptr);
  }
  SignalsToChild(const SignalsToChild&) = delete;
  SignalsToChild& operator=(const SignalsToChild&) = delete;

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
  struct sigaction old_interrupt_ {
  }, old_terminate_{};
};

/// A file descriptor that is closed at the end.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  ~Descriptor() { close(); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  operator int() const { return number_; }
  void close() {
    if (number_ >= 0) ::close(number_);
    number_ = -1;
  }

 private:
  int number_;
};

// Qt looks for a display unless told that there is none.
std::vector<std::string> child_environment() {
  std::vector<std::string> variables;
  for (char** variable = environ; *variable; ++variable) variables.push_back(*variable);
  if (!std::getenv("QT_QPA_PLATFORM")) variables.push_back("QT_QPA_PLATFORM=offscreen");
  return variables;
}

std::vector<char*> pointers_to(const std::vector<std::string>& texts) {
  std::vector<char*> result;
  for (const std::string& text : texts) result.push_back(const_cast<char*>(text.c_str()));
  result.push_back(nullptr);
  return result;
}

[[noreturn]] void cannot_start(const std::string& program, int error) {
  throw Error(fmt::format("cannot start {}: {}; check that it is a program that runs here", program,
                          std::strerror(error)));
}

// Starts the program in a process group of its own, with `output` as its standard output and error.
pid_t spawn(const std::vector<std::string>& arguments, int output) {
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&files, output, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&files, output, STDERR_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  posix_spawnattr_setpgroup(&attributes, 0);
  const std::vector<std::string> environment = child_environment();
  pid_t child = 0;
  const int error = ::posix_spawnp(&child, arguments.at(0).c_str(), &files, &attributes,
                                   pointers_to(arguments).data(), pointers_to(environment).data());
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  if (error) cannot_start(arguments[0], error);
  return child;
}

// Reads until every writer is gone; lines to `on_line`, bytes to `log` where there is one.
void pump(int input, std::FILE* log, const LineVisitor& on_line) {
  char block[4096];
  std::string line;
  while (true) {
    const ssize_t bytes = ::read(input, block, sizeof block);
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes <= 0) break;
    if (log) {
      std::fwrite(block, 1, std::size_t(bytes), log);
      std::fflush(log);
    }
    for (const char c : std::string_view(block, std::size_t(bytes))) {
      if (c != '\n') {
        line += c;
      } else {
        on_line(line);
        line.clear();
      }
    }
  }
  if (!line.empty()) on_line(line);
}

ProcessEnd wait_for(pid_t child) {
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFSIGNALED(status)) return {0, WTERMSIG(status)};
  return {WEXITSTATUS(status), 0};
}

}  // namespace

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

ProcessEnd run_process(const std::vector<std::string>& arguments, const fs::path& log,
                       const LineVisitor& on_line) {
  using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;
  const File file(log.empty() ? nullptr : std::fopen(log.c_str(), "abe"),
                  [](std::FILE* open) { return open ? std::fclose(open) : 0; });
  if (!log.empty() && !file)
    throw Error(fmt::format("cannot write {}: {}; write to a folder that you may change",
                            log.string(), std::strerror(errno)));
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) cannot_start(arguments.at(0), errno);
  Descriptor input(ends[0]), output(ends[1]);

  SignalsToChild signals;
  const pid_t child = spawn(arguments, output);
  signals.set_child(child);
  output.close();
  try {
    pump(input, file.get(), on_line);
  } catch (...) {  // nobody reads on: the child must not stay
    ::kill(-child, SIGKILL);
    wait_for(child);
    throw;
  }
  const ProcessEnd end = wait_for(child);
  signals.set_child(0);
  if (signals.received())
    throw Error(fmt::format("stopped by a signal while {} ran", arguments[0]),
                ExitCode::interrupted);
  return end;
}

}  // namespace gs
