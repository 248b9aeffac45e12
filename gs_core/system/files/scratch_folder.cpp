// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/files/scratch_folder.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "gs_core/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
constexpr const char *kLock = ".gemsplat.scratch", *kFiles = "files";
constexpr std::size_t kRandom = 6;  // characters that mkdtemp() puts in the place of XXXXXX

[[noreturn]] void refuse(const std::string& name, int error) {
  throw Error(
      fmt::format("cannot make a folder {}: {}; set TMPDIR to a folder that you may write to", name,
                  std::strerror(error)));
}

/// The lock goes last, so that the next one finishes what a kill has cut off.
void remove_with_lock(const fs::path& folder) {
  std::error_code ignored;
  fs::remove_all(folder / kFiles, ignored);
  if (!ignored) ::unlink((folder / kLock).c_str());
  ::rmdir(folder.c_str());
}

/// Takes the lock of a folder that another process has left, and removes the folder. Folders of
/// other users, of processes that live, and without our lock stay.
void remove_if_abandoned(const fs::path& folder) {
  const int lock = ::open((folder / kLock).c_str(), O_RDWR | O_NOFOLLOW | O_CLOEXEC);
  if (lock < 0) return;
  struct stat status;
  if (::fstat(lock, &status) == 0 && status.st_uid == ::geteuid() &&
      ::flock(lock, LOCK_EX | LOCK_NB) == 0)
    remove_with_lock(folder);
  ::close(lock);
}

void remove_abandoned(const fs::path& above, const std::string& prefix) {
  std::error_code error;
  for (fs::directory_iterator entry(above, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.size() == prefix.size() + kRandom && name.starts_with(prefix))
      remove_if_abandoned(entry->path());
  }
}

}  // namespace

ScratchFolder::ScratchFolder(const std::string& prefix) {
  std::error_code error;
  const fs::path above = fs::temp_directory_path(error);
  if (error) refuse("for temporary files", error.value());
  remove_abandoned(above, prefix);
  while (!make((above / (prefix + std::string(kRandom, 'X'))).string())) remove();
}

ScratchFolder::~ScratchFolder() { remove(); }

/// Returns false where another process has taken the new folder for an abandoned one, before its
/// lock was held.
bool ScratchFolder::make(const std::string& pattern) {
  std::string name = pattern;
  if (!mkdtemp(name.data())) refuse(pattern, errno);
  folder_ = name;
  path_ = folder_ / kFiles;
  lock_ = ::open((folder_ / kLock).c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  int error = lock_ < 0 ? errno : 0;
  if (!error && ::mkdir(path_.c_str(), 0700) != 0) error = errno;
  if (error == ENOENT) return false;
  if (error) {
    remove();
    refuse(name, error);
  }
  const bool is_locked = ::flock(lock_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK;
  return is_locked && ::access(path_.c_str(), F_OK) == 0;
}

void ScratchFolder::remove() const {
  remove_with_lock(folder_);
  if (lock_ >= 0) ::close(lock_);
}

}  // namespace gs
