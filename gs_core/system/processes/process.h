// SPDX-License-Identifier: Apache-2.0
// Other programs, without a shell between: finding them, starting them, and how they ended. All
// children of this program are started here. run_process() in subprocess.h runs one to its end and
// reads its output.
#pragma once

#include <sys/types.h>
#include <unistd.h>

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gs {

/// A file descriptor that is closed at the end.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  ~Descriptor() { close(); }
  Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Descriptor& operator=(Descriptor&&) = delete;
  operator int() const { return number_; }
  void close() {
    if (number_ >= 0) ::close(number_);
    number_ = -1;
  }

 private:
  int number_;
};

/// Opens a file to append to, and makes it if it is missing. Throws Error.
Descriptor open_log(const std::filesystem::path& file);

/// The file that `name` runs: itself if it has a '/', else the first of that name on the PATH.
/// Nothing if no such file may be run.
std::optional<std::filesystem::path> find_program(const std::string& name);

/// This program's own file.
std::filesystem::path own_program();
/// What to start for another process of gemsplat: this one, also if its file was replaced meanwhile.
const std::filesystem::path& program_to_start();
/// Where this process is not gemsplat, but an interpreter: what to start instead.
void set_program_to_start(std::filesystem::path program);

/// How a program ended.
struct ProcessEnd {
  int exit_code = 0;  // if `signal` is 0
  int signal = 0;     // the signal that killed it
  bool good() const { return exit_code == 0 && signal == 0; }
};

struct ChildOptions {
  int output = -1;                          // descriptor of its output and errors; -1: none
  std::vector<std::string> variables = {};  // "NAME=value", added to the environment
  std::filesystem::path folder = {};        // that it works in; empty: that of this program
  bool is_detached = false;                 // has a session of its own and outlives this program
  bool saves_on_term = false;               // takes its time to save its work after SIGTERM
};

/// Starts `arguments` (the program first) with /dev/null as its input, and returns at once. Unless
/// it is detached, the child has a process group of its own, whose number is that of the child, and
/// does not outlive this program, even if that ends by SIGKILL: a small guard process then sends
/// SIGTERM to the whole group, which holds the programs that a script in COLMAP's place has started,
/// and SIGKILL to what is left of it after five seconds (ten minutes if `saves_on_term`). On Linux
/// the child itself gets SIGTERM already when the thread that called ends. Throws Error if the
/// program cannot be started.
pid_t start_child(const std::vector<std::string>& arguments, const ChildOptions& options = {});

/// Waits until a child ends.
ProcessEnd wait_for_child(pid_t child);

struct ChildEnd {
  pid_t process;
  ProcessEnd end;
};

/// A child that has ended and was not reported before; nothing if there is none. Does not wait.
std::optional<ChildEnd> ended_child();

}  // namespace gs
