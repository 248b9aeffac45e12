// SPDX-License-Identifier: Apache-2.0
#include "cli/folder_lock.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>
#include <sys/file.h>
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

[[noreturn]] void refuse(const std::filesystem::path& file, const Holder& holder) {
  throw Error(
      fmt::format("another process{} is at work on {}; wait until it has ended, or stop it",
                  holder.process ? fmt::format(" ({} on {})", holder.process, holder.host) : "",
                  file.parent_path().string()));
}

}  // namespace

FolderLock::FolderLock(const std::filesystem::path& file, Kind kind) {
  std::error_code ignored;  // open() says what is wrong
  std::filesystem::create_directories(file.parent_path(), ignored);
  descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT, 0666);  // children inherit it
  if (descriptor_ < 0)
    throw Error(fmt::format("cannot write {}: {}; name another output", file.string(),
                            std::strerror(errno)));
  const int operation = (kind == Kind::alone ? LOCK_EX : LOCK_SH) | LOCK_NB;
  const Clock::time_point start = Clock::now();
  while (::flock(descriptor_, operation) != 0) {
    const Holder holder = read_holder(descriptor_);
    if (!is_dead(holder) || Clock::now() - start > kPatience) {
      ::close(descriptor_);
      refuse(file, holder);
    }
    std::this_thread::sleep_for(kRetryEvery);
  }
  write_holder(descriptor_);  // of many that share it, the last
}

FolderLock::~FolderLock() { ::close(descriptor_); }

}  // namespace gs
