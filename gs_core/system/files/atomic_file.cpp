// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/files/atomic_file.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstring>
#include <random>

#include "gs_core/error.h"

namespace gs {
namespace {

const char* remedy(int error) {
  switch (error) {
    case ENOSPC:
    case EDQUOT:
    case EFBIG: return "free some space or write elsewhere";
    case EACCES:
    case EPERM:
    case EROFS: return "write to a folder that you may change";
    case EISDIR:
    case ENOTDIR:
    case EEXIST:
      return "choose another name: a file stands where a folder is needed, or a folder in its "
             "place";
    default: return "check the path and the disk, or write elsewhere";
  }
}

std::atomic<WriteHook*> write_hook = nullptr;

void ask_hook(WritePoint point, const std::filesystem::path& file) {
  if (WriteHook* const hook = write_hook) hook->before(point, file);
}

constexpr std::size_t kRandomDigits = 16;  // of temporary_name()

// The process in the name ".NAME.PROCESS.RANDOM.tmp"; 0 for other names.
pid_t owner_of(const std::string& name) {
  if (!name.starts_with('.') || !name.ends_with(".tmp")) return 0;
  const std::size_t end = name.rfind('.', name.size() - 5);
  const std::size_t begin = end == name.npos || end == 0 ? name.npos : name.rfind('.', end - 1);
  if (begin == name.npos || begin == 0) return 0;
  const std::string_view random(name.data() + end + 1, name.size() - end - 5);
  if (random.size() != kRandomDigits || random.find_first_not_of("0123456789abcdef") != random.npos)
    return 0;
  pid_t owner = 0;
  const auto [rest, failure] = std::from_chars(name.data() + begin + 1, name.data() + end, owner);
  return failure == std::errc() && rest == name.data() + end ? owner : 0;
}

// A rename is on disk only when its folder is. Some file systems cannot sync folders; an error is
// ignored.
void sync_folder(const std::filesystem::path& folder) {
  const int descriptor = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

constexpr mode_t kRights = 0666;  // less the umask

// A file without a name, which is gone when the process ends, however it ends. -1 where the file
// system has no such files, or where no name could be given to it later.
int open_unnamed([[maybe_unused]] const std::filesystem::path& folder) {
#ifdef O_TMPFILE
  static const bool can_be_named = ::access("/proc/self/fd", X_OK) == 0;
  if (can_be_named)
    return ::open(folder.empty() ? "." : folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, kRights);
#endif
  return -1;
}

// Gives such a file a name that nothing has. Returns 0 or the error.
int name_file(int descriptor, const std::filesystem::path& path) {
  const std::string unnamed = fmt::format("/proc/self/fd/{}", descriptor);
  const int result = ::linkat(AT_FDCWD, unnamed.c_str(), AT_FDCWD, path.c_str(), AT_SYMLINK_FOLLOW);
  return result == 0 ? 0 : errno;
}

// The name of a temporary file beside `path`, another one at each call: ".NAME.PROCESS.RANDOM" with
// 64 random bits, and the ending. Nobody can guess it, and put a link there.
std::filesystem::path temporary_name(const std::filesystem::path& path, std::string_view ending) {
  std::random_device random;
  return path.parent_path() / fmt::format(".{}.{}.{:08x}{:08x}{}", path.filename().string(),
                                          ::getpid(), random(), random(), ending);
}

// Calls make(name) for temporary names until one is free. Returns 0 or the error.
template <class Make>
int with_temporary_name(const std::filesystem::path& path, std::string_view ending,
                        std::filesystem::path& name, const Make& make) {
  int error = 0;
  do {
    name = temporary_name(path, ending);
    error = make(name);
  } while (error == EEXIST);
  return error;
}

[[noreturn]] void cannot_write(const std::filesystem::path& path, int error) {
  throw Error(
      fmt::format("cannot write {}: {}; {}", path.string(), std::strerror(error), remedy(error)));
}

// Makes a temporary file beside `path` and opens it to write. O_EXCL takes no file, and follows no
// link, that is there already.
int open_temporary(const std::filesystem::path& path, std::string_view ending,
                   std::filesystem::path& name) {
  int descriptor = -1;
  const int error =
      with_temporary_name(path, ending, name, [&](const std::filesystem::path& free_name) {
        descriptor = ::open(free_name.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, kRights);
        return descriptor < 0 ? errno : 0;
      });
  if (error) cannot_write(path, error);
  return descriptor;
}

}  // namespace

std::filesystem::path make_temporary_beside(const std::filesystem::path& path,
                                            std::string_view ending) {
  std::filesystem::path name;
  ::close(open_temporary(path, ending, name));
  return name;
}

void set_write_hook(WriteHook* hook) { write_hook = hook; }

void remove_leftovers(const std::filesystem::path& folder, const std::string& file_name) {
  std::error_code ignored;
  const std::string prefix = file_name.empty() ? "." : "." + file_name + ".";
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    const pid_t owner = name.starts_with(prefix) ? owner_of(name) : 0;
    if (owner > 0 && ::kill(owner, 0) != 0 && errno == ESRCH)
      std::filesystem::remove(entry.path(), ignored);
  }
}

AtomicFile::AtomicFile(std::filesystem::path path) : named_(path), path_(std::move(path)) {
  std::error_code error;
  if (std::filesystem::is_symlink(path_, error)) {  // the link stays, its target is new
    const auto target = std::filesystem::weakly_canonical(path_, error);
    if (error) fail(error.value());
    path_ = target;
  }
  const auto status = std::filesystem::status(path_, error);
  if (std::filesystem::is_directory(status)) fail(EISDIR);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) fail(EEXIST);
  error.clear();
  if (path_.has_parent_path()) std::filesystem::create_directories(path_.parent_path(), error);
  if (error) fail(error.value());
  ask_hook(WritePoint::create, path_);
  int descriptor = open_unnamed(path_.parent_path());
  if (descriptor < 0) descriptor = open_temporary(path_, ".tmp", temporary_);
  file_ = ::fdopen(descriptor, "wb");
  if (file_) return;
  const int reason = errno;
  ::close(descriptor);
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
  fail(reason);
}

AtomicFile::~AtomicFile() {
  if (!file_) return;
  std::fclose(file_);
  std::error_code ignored;
  if (!temporary_.empty()) std::filesystem::remove(temporary_, ignored);
}

void AtomicFile::write(const void* data, std::size_t bytes) {
  ask_hook(WritePoint::write, path_);
  if (bytes && std::fwrite(data, 1, bytes, file_) != bytes) fail(errno);
}

void AtomicFile::commit(Durability durability, const std::function<void()>& before_naming) {
  const bool is_synced = durability == Durability::synced;
  ask_hook(WritePoint::sync, path_);
  if (std::fflush(file_) != 0 || (is_synced && ::fsync(::fileno(file_)) != 0)) fail(errno);
  ask_hook(WritePoint::rename, path_);
  if (before_naming) before_naming();
  if (const int error = give_name()) fail(error);
  std::fclose(file_);
  file_ = nullptr;
  ask_hook(WritePoint::sync_folder, path_);
  if (is_synced) sync_folder(path_.parent_path());
}

// A file without a name gets its own one at once, unless an older file has it: only rename replaces
// that in one step.
int AtomicFile::give_name() {
  if (temporary_.empty()) {
    int error = name_file(::fileno(file_), path_);
    if (error != EEXIST) return error;
    error = with_temporary_name(path_, ".tmp", temporary_, [&](const std::filesystem::path& name) {
      return name_file(::fileno(file_), name);
    });
    if (error) return error;
  }
  return std::rename(temporary_.c_str(), path_.c_str()) == 0 ? 0 : errno;
}

void AtomicFile::fail(int error) { cannot_write(path_, error); }

}  // namespace gs
