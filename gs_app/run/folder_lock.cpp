// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/folder_lock.h"

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

#include "gs_core/error.h"
#include "gs_core/log.h"

namespace gs {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds kPatience{60};  // children end after the step at hand, and save
constexpr std::chrono::milliseconds kRetryEvery{100};

struct Holder {
  int process = 0;
  std::string host;
};

std::string host_name() {
  char name[256] = {};
  ::gethostname(name, sizeof name - 1);
  return name;
}

Holder read_holder(int descriptor) {
  char text[300] = {}, host[256] = {};
  Holder holder;
  if (::pread(descriptor, text, sizeof text - 1, 0) > 0 &&
      std::sscanf(text, "%d %255s", &holder.process, host) == 2)
    holder.host = host;
  return holder;
}

void write_holder(int descriptor) {
  const std::string text = fmt::format("{} {}\n", ::getpid(), host_name());
  if (::ftruncate(descriptor, 0) != 0 || ::pwrite(descriptor, text.data(), text.size(), 0) < 0)
    log_warning("the lock file could not be written; the lock holds nevertheless");
}

bool is_dead(const Holder& holder) {
  return holder.process > 0 && holder.host == host_name() && ::kill(holder.process, 0) != 0 &&
         errno == ESRCH;
}

// Whether the name still means the open file.
bool is_still(const std::filesystem::path& file, int descriptor) {
  struct stat named, opened;
  return ::stat(file.c_str(), &named) == 0 && ::fstat(descriptor, &opened) == 0 &&
         named.st_ino == opened.st_ino && named.st_dev == opened.st_dev;
}

[[noreturn]] void refuse(const std::filesystem::path& folder, const Holder& holder) {
  throw Error(
      fmt::format("another process{} is working on {}; wait until it has ended, or stop it",
                  holder.process ? fmt::format(" ({} on {})", holder.process, holder.host) : "",
                  folder.string()));
}

}  // namespace

FolderLock::FolderLock(const std::filesystem::path& file, const std::filesystem::path& folder,
                       Kind kind, File afterwards)
    : file_(file), afterwards_(afterwards) {
  std::error_code ignored;  // open() says what is wrong
  std::filesystem::create_directories(file.parent_path(), ignored);
  const int operation = (kind == Kind::alone ? LOCK_EX : LOCK_SH) | LOCK_NB;
  const Clock::time_point start = Clock::now();
  for (;;) {
    descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT, 0666);  // children inherit it
    if (descriptor_ < 0)
      throw Error(fmt::format("cannot write {}: {}; name another output", file.string(),
                              std::strerror(errno)));
    if (::flock(descriptor_, operation) == 0) {
      if (is_still(file, descriptor_)) break;  // else its holder has removed it meanwhile
    } else if (errno == EWOULDBLOCK) {
      const Holder holder = read_holder(descriptor_);
      if (!is_dead(holder) || Clock::now() - start > kPatience) {
        ::close(descriptor_);
        refuse(folder, holder);
      }
      std::this_thread::sleep_for(kRetryEvery);
    } else if (errno != EINTR) {
      log_warning("{} cannot be locked ({}): make sure that no other process works there",
                  folder.string(), std::strerror(errno));
      return;
    }
    ::close(descriptor_);
  }
  write_holder(descriptor_);  // of many that share it, the last
}

FolderLock::~FolderLock() {
  std::error_code ignored;
  if (afterwards_ == File::removed) std::filesystem::remove(file_, ignored);
  ::close(descriptor_);
}

}  // namespace gs
