// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/files/output_lock.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <string>
#include <thread>
#include <utility>

#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/host_name.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
constexpr const char* kLockOfFolder = ".gemsplat.lock";
constexpr std::chrono::seconds kPatience{60};  // children end after the step at hand, and save
constexpr std::chrono::milliseconds kRetryEvery{100};

struct Holder {
  int process = 0;
  std::string host;
};

Holder read_holder(int descriptor) {
  char text[300] = {}, host[256] = {};
  Holder holder;
  if (::pread(descriptor, text, sizeof text - 1, 0) > 0 &&
      std::sscanf(text, "%d %255s", &holder.process, host) == 2)
    holder.host = host;
  return holder;
}

// Says for other processes who holds the lock. A full disk costs the words, and not the lock.
void write_holder(int descriptor) {
  const std::string text = fmt::format("{} {}\n", ::getpid(), host_name());
  [[maybe_unused]] const bool is_written =
      ::ftruncate(descriptor, 0) == 0 && ::pwrite(descriptor, text.data(), text.size(), 0) > 0;
}

bool is_dead(const Holder& holder) {
  return holder.process > 0 && holder.host == host_name() && ::kill(holder.process, 0) != 0 &&
         errno == ESRCH;
}

// Whether the name still means the open file.
bool is_still(const fs::path& file, int descriptor) {
  struct stat named, opened;
  return ::lstat(file.c_str(), &named) == 0 && ::fstat(descriptor, &opened) == 0 &&
         named.st_ino == opened.st_ino && named.st_dev == opened.st_dev;
}

[[noreturn]] void refuse(const fs::path& output, const Holder& holder) {
  throw Error(
      fmt::format("another process{} is working on {}; wait until it has ended, or stop it",
                  holder.process ? fmt::format(" ({} on {})", holder.process, holder.host) : "",
                  output.string()));
}

// The file may belong to another user, who left it behind; to lock it, reading is enough. A symbolic
// link is no lock file of ours.
int open_lock(const fs::path& file) {
  constexpr int kFlags = O_CREAT | O_NOFOLLOW;  // and no O_CLOEXEC: children inherit it
  const int descriptor = ::open(file.c_str(), kFlags | O_RDWR, 0666);
  if (descriptor >= 0 || errno != EACCES) return descriptor;
  const int of_another = ::open(file.c_str(), O_NOFOLLOW | O_RDONLY);
  if (of_another < 0 && errno == ENOENT) errno = EACCES;  // the folder is why none could be made
  return of_another;
}

fs::path real(const fs::path& path) { return fs::weakly_canonical(fs::absolute(path)); }

}  // namespace

bool is_empty_output(const fs::path& folder) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    if (entry->path().filename() != kLockOfFolder) return false;
  return !error;
}

OutputLock OutputLock::of_new_folder(const fs::path& folder) {
  const auto check = [&] {
    std::error_code ignored;
    if (fs::exists(folder, ignored) && !is_empty_output(folder))
      throw UsageError(
          fmt::format("{} exists already, and nothing is overwritten; name a new folder with -o, "
                      "or add --force, which renames it to {}.bak-1 or the like",
                      folder.string(), folder.string()));
  };
  check();
  OutputLock lock = of_folder(folder);
  check();  // no other process writes to it from here on
  return lock;
}

OutputLock OutputLock::of_freed_folder(const fs::path& folder,
                                       const std::vector<fs::path>& needed) {
  OutputLock lock = of_folder(folder);
  if (!is_empty_output(folder))
    log_info("the older {} is now {}", folder.string(), lock.move_folder_aside(needed).string());
  return lock;
}

OutputLock OutputLock::of_file(const fs::path& file) {
  return {file, real(file).parent_path(), Kind::alone};
}

OutputLock::OutputLock(const fs::path& output, const fs::path& folder, Kind kind)
    : output_(output), folder_(real(folder)), kind_(kind) {
  if (!folder_.has_filename()) folder_ = folder_.parent_path();  // "runs/a/"
  const bool is_folder = output == folder;
  file_ = folder_ / (is_folder ? kLockOfFolder : "." + name_of_output() + ".lock");
  make_folder();
  acquire();
}

std::string OutputLock::name_of_output() const { return real(output_).filename().string(); }

OutputLock::OutputLock(OutputLock&& other) noexcept
    : output_(std::move(other.output_)), folder_(std::move(other.folder_)),
      file_(std::move(other.file_)), kind_(other.kind_),
      descriptor_(std::exchange(other.descriptor_, -1)), made_(std::move(other.made_)) {
  other.made_.clear();
}

OutputLock::~OutputLock() {
  release(file_);
  for (const fs::path& folder : made_) ::rmdir(folder.c_str());  // only if it is empty
}

void OutputLock::make_folder() {
  std::error_code error;
  for (fs::path above = folder_; !fs::exists(above, error) && above.has_relative_path();
       above = above.parent_path())
    made_.push_back(above);
  fs::create_directories(folder_, error);
  if (error)
    throw Error(fmt::format("cannot make the folder {}: {}; choose another with -o",
                            folder_.string(), error.message()));
}

void OutputLock::acquire() {
  const int operation = (kind_ == Kind::alone ? LOCK_EX : LOCK_SH) | LOCK_NB;
  const Clock::time_point start = Clock::now();
  for (;;) {
    descriptor_ = open_lock(file_);
    if (descriptor_ < 0)
      throw Error(fmt::format("cannot write to {}: {} ({}); name another output", output_.string(),
                              std::strerror(errno), file_.string()));
    if (::flock(descriptor_, operation) == 0) {
      if (is_still(file_, descriptor_)) break;  // else its holder has removed it meanwhile
    } else if (errno == EWOULDBLOCK) {
      const Holder holder = read_holder(descriptor_);
      if (!is_dead(holder) || Clock::now() - start > kPatience) {
        ::close(std::exchange(descriptor_, -1));
        made_.clear();
        refuse(output_, holder);
      }
      std::this_thread::sleep_for(kRetryEvery);
    } else if (errno != EINTR) {
      log_warning("{} cannot be locked ({}): make sure that no other process works there",
                  output_.string(), std::strerror(errno));
      return;
    }
    ::close(std::exchange(descriptor_, -1));
  }
  write_holder(descriptor_);  // of many that share it, the last
  if (kind_ == Kind::alone)
    remove_leftovers(folder_, file_.filename() == kLockOfFolder ? "" : name_of_output());
}

// A file that others may share stays: they hold the lock of this file, and not of a new one.
void OutputLock::release(const fs::path& file) {
  if (descriptor_ < 0) return;
  if (kind_ == Kind::alone && is_still(file, descriptor_)) ::unlink(file.c_str());
  ::close(std::exchange(descriptor_, -1));
}

fs::path OutputLock::move_folder_aside(const std::vector<fs::path>& needed) {
  check_may_move(folder_, needed);
  const fs::path backup = move_aside(output_);
  release(backup / file_.filename());
  made_.clear();
  folder_ = real(output_);  // a symbolic link was moved, and not its target
  file_ = folder_ / file_.filename();
  make_folder();
  acquire();
  return backup;
}

}  // namespace gs
