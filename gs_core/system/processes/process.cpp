// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/processes/process.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#ifdef __linux__
#include <sys/prctl.h>
#include <sys/syscall.h>
#endif

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <string_view>

#include "gs_core/error.h"
#include "gs_core/system/processes/signals.h"
#include "gs_core/system/sanitizers.h"

extern char** environ;

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr int kCannotStart = 127;  // exit code of a shell in that case

fs::path g_program_to_start = "/proc/self/exe";

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
  const char* folder;
  char* const* arguments;
  char* const* environment;
  int output, trouble;  // `trouble`: a pipe that exec closes, or that gets the number of its error
  int guard;            // a socket to the guard, which exec closes; -1: it has none
  pid_t parent;
};

// Where the system has it, a fork without the handlers that libraries have registered. OpenBLAS, for
// example, takes a lock in its handler: while two threads fork, the child of the one has the lock that
// the other one holds, nobody there releases it, and a fork of that child would wait for ever.
pid_t fork_bare() {
#if defined(__GLIBC__) && !defined(GS_THREAD_SANITIZER)  // which has a handler of its own
#if __GLIBC_PREREQ(2, 34)
  return ::_Fork();
#endif
#endif
  return ::fork();
}

// In the child: only calls that POSIX allows between fork and exec.
[[noreturn]] void become(const Start& start) {
  if (start.guard < 0) {
    ::setsid();
  } else {
    ::setpgid(0, 0);
    const pid_t self = ::getpid();
    if (::send(start.guard, &self, sizeof self, MSG_NOSIGNAL) != sizeof self) ::_exit(kCannotStart);
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
  if (*start.folder == '\0' || ::chdir(start.folder) == 0)
    ::execve(start.program, start.arguments, start.environment);
  const int error = errno;
  [[maybe_unused]] const auto written = ::write(start.trouble, &error, sizeof error);
  ::_exit(kCannotStart);
}

// ---- the guard, a process that ends a child's group when this program is gone ---------------------------

constexpr int kGraceSeconds = 5, kSavingSeconds = 600;  // between SIGTERM and SIGKILL
constexpr int kLooksPerSecond = 10;
constexpr char kEnded = 'e';  // what the guard is told when the child has ended

void close_from(int first) {
#ifdef SYS_close_range
  if (::syscall(SYS_close_range, unsigned(first), ~0u, 0u) == 0) return;
#endif
  for (int i = first, last = int(::sysconf(_SC_OPEN_MAX)); i < last; ++i) ::close(i);
}

bool read_all(int socket, void* data, std::size_t bytes) {
  ssize_t count = 0;
  do {
    count = ::read(socket, data, bytes);
  } while (count < 0 && errno == EINTR);
  return count == ssize_t(bytes);
}

// Waits until the socket's other ends are closed. They are those of this program, which says kEnded
// before, and until its exec that of the child, which has written its number. Only calls that POSIX
// allows after fork; no descriptor but the socket stays open, so that locks and pipes are not held.
[[noreturn]] void guard_group(int socket, bool saves_on_term) {
  ::setsid();
#ifdef __linux__
  ::prctl(PR_SET_NAME, "gs-guard");
#endif
  for (const int signal : kStopSignals) ::signal(signal, SIG_IGN);
  ::dup2(socket, STDIN_FILENO);
  close_from(STDOUT_FILENO);
  pid_t child = 0;
  char word = 0;
  if (!read_all(STDIN_FILENO, &child, sizeof child)) ::_exit(0);  // it was never started
  if (read_all(STDIN_FILENO, &word, sizeof word)) ::_exit(0);
  // The child itself has had its SIGTERM; a second one could cost the work that it saves.
  if (!saves_on_term) ::kill(-child, SIGTERM);
  const int looks = (saves_on_term ? kSavingSeconds : kGraceSeconds) * kLooksPerSecond;
  for (int i = 0; i < looks && ::kill(-child, 0) == 0; ++i) {
    const timespec pause{0, 1'000'000'000 / kLooksPerSecond};
    ::nanosleep(&pause, nullptr);
  }
  ::kill(-child, SIGKILL);
  ::_exit(0);
}

// Starts a guard, which is no child of this program, and returns our end of its socket.
Descriptor start_guard(const std::string& name, bool saves_on_term) {
  int ends[2];  // sockets and no pipe: a guard that was killed must not cost us a SIGPIPE
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) cannot_start(name, errno);
  const Descriptor to_read(ends[0]);
  Descriptor to_write(ends[1]);
  const pid_t between = fork_bare();
  if (between < 0) cannot_start(name, errno);
  if (between == 0) {
    const pid_t guard = fork_bare();
    if (guard == 0) guard_group(to_read, saves_on_term);
    ::_exit(guard < 0 ? kCannotStart : 0);
  }
  int status = 0;
  while (::waitpid(between, &status, 0) < 0 && errno == EINTR) {
  }
  if (status != 0) cannot_start(name, EAGAIN);
  return to_write;
}

/// The guards of the children that run, by child.
class Guards {
 public:
  void add(pid_t child, Descriptor guard) {
    const std::lock_guard lock(mutex_);
    guards_.insert_or_assign(child, std::make_unique<Descriptor>(std::move(guard)));
  }
  /// The child has ended, and its number is not yet free for another process.
  void dismiss(pid_t child) {
    const std::lock_guard lock(mutex_);
    const auto guard = guards_.find(child);
    if (guard == guards_.end()) return;
    ::send(*guard->second, &kEnded, sizeof kEnded, MSG_NOSIGNAL);
    guards_.erase(guard);
  }

 private:
  std::mutex mutex_;
  std::map<pid_t, std::unique_ptr<Descriptor>> guards_;
};

Guards& guards() {
  static Guards* const all = new Guards;  // its sockets close when the process ends, and not before
  return *all;
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

const fs::path& program_to_start() { return g_program_to_start; }

void set_program_to_start(fs::path program) { g_program_to_start = std::move(program); }

namespace {

// A program may have been started with SIGCHLD ignored. Then the kernel forgets how children ended,
// and a failed one would count as a success.
void keep_ends_of_children() {
  struct sigaction action {};
  if (::sigaction(SIGCHLD, nullptr, &action) != 0) return;
  const bool is_ignored = action.sa_handler == SIG_IGN || (action.sa_flags & SA_NOCLDWAIT) != 0;
  if (is_ignored) std::signal(SIGCHLD, SIG_DFL);
}

}  // namespace

pid_t start_child(const std::vector<std::string>& arguments, const ChildOptions& options) {
  const std::string& name = arguments.at(0);
  const std::string program = find_program(name).value_or(name).string();
  const std::vector<std::string> environment = environment_with(options.variables);
  const std::vector<char*> argument_pointers = pointers_to(arguments);
  const std::vector<char*> environment_pointers = pointers_to(environment);
  keep_ends_of_children();
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) cannot_start(name, errno);
  const Descriptor trouble(ends[0]);
  Descriptor trouble_of_child(ends[1]);
  Descriptor guard =
      options.is_detached ? Descriptor(-1) : start_guard(name, options.saves_on_term);
  const Start start{program.c_str(),
                    options.folder.c_str(),
                    argument_pointers.data(),
                    environment_pointers.data(),
                    options.output,
                    trouble_of_child,
                    guard,
                    ::getpid()};
  const pid_t child = fork_bare();
  if (child == 0) become(start);
  if (child < 0) cannot_start(name, errno);
  if (guard >= 0) guards().add(child, std::move(guard));
  trouble_of_child.close();
  if (const int error = error_from(trouble)) {
    wait_for_child(child);
    cannot_start(name, error);
  }
  return child;
}

ProcessEnd wait_for_child(pid_t child) {
  siginfo_t info;
  while (::waitid(P_PID, id_t(child), &info, WEXITED | WNOWAIT) < 0 && errno == EINTR) {
  }
  guards().dismiss(child);
  int status = 0;
  pid_t ended = 0;
  while ((ended = ::waitpid(child, &status, 0)) < 0 && errno == EINTR) {
  }
  if (ended != child)
    throw Error("cannot learn how a program ended: another part of this process waited for it");
  return end_of(status);
}

std::optional<ChildEnd> ended_child() {
  siginfo_t info{};
  if (::waitid(P_ALL, 0, &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid == 0)
    return std::nullopt;
  return ChildEnd{info.si_pid, wait_for_child(info.si_pid)};
}

}  // namespace gs
