// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/uploads.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <sys/mman.h>

#include <cerrno>
#include <cstring>
#include <map>
#include <string_view>

#include "data_loaders/photos/photo_names.h"
#include "gs_app/studio/project.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_model/formats/coding/zip_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kLargestEntry = std::uint64_t(2) << 30;  // of an archive, in memory

/// A limit is reached, or the disk is full.
struct NoRoom : Error {
  using Error::Error;
};

std::uint64_t size_of(const fs::path& file) {
  std::error_code none;
  const std::uintmax_t bytes = fs::file_size(file, none);
  return none ? 0 : bytes;
}

[[noreturn]] void fail_to_write(const fs::path& file, int error) {
  throw Error(
      fmt::format("cannot write {}: {}; free some space and drop the files again: what has "
                  "arrived stays",
                  file.string(), std::strerror(error)));
}

void append(const fs::path& file, const std::string& bytes) {
  fs::create_directories(file.parent_path());
  const Descriptor to(::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
  if (to < 0) fail_to_write(file, errno);
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t count = ::write(to, bytes.data() + done, bytes.size() - done);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) fail_to_write(file, errno);
    done += std::size_t(count);
  }
}

// Brings the file to the disk before it gets its name.
void finish(const fs::path& part, const fs::path& file) {
  const Descriptor written(::open(part.c_str(), O_RDONLY | O_CLOEXEC));
  if (written < 0 || ::fsync(written) != 0) fail_to_write(file, errno);
  fs::create_directories(file.parent_path());
  if (const std::error_code error = rename_to_new(part, file)) fail_to_write(file, error.value());
}

/// The bytes of a file, as long as this lives.
class MappedFile {
 public:
  explicit MappedFile(const fs::path& path) : bytes_(size_of(path)) {
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    if (file >= 0 && bytes_ > 0) data_ = ::mmap(nullptr, bytes_, PROT_READ, MAP_PRIVATE, file, 0);
    if (data_ == MAP_FAILED) throw Error("cannot read " + path.string());
  }
  ~MappedFile() { ::munmap(data_, bytes_); }
  MappedFile(const MappedFile&) = delete;
  std::string_view bytes() const { return {static_cast<const char*>(data_), bytes_}; }

 private:
  std::size_t bytes_;
  void* data_ = MAP_FAILED;
};

// What systems put beside the files of a person.
bool is_clutter(const std::string& name) {
  const std::string file = name.substr(name.rfind('/') + 1);
  return file.empty() || file.front() == '.' || file == "Thumbs.db" ||
         name.starts_with("__MACOSX/");
}

// "fox/" where all entries lie in that folder: the project stands for it. They are sorted.
std::string top_folder_of(const std::map<std::string, PackedEntry>& entries) {
  if (entries.empty()) return "";
  const std::string& first = entries.begin()->first;
  const std::string top = first.substr(0, first.find('/') + 1);
  return entries.rbegin()->first.starts_with(top) ? top : "";
}

}  // namespace

Uploads::Uploads(fs::path project, UploadLimits limits)
    : project_(std::move(project)), input_(project_ / "input"), parts_(project_ / ".upload"),
      limits_(limits) {}

// A file of another size is another file.
fs::path Uploads::part_of(const fs::path& path, std::uint64_t of) const {
  return parts_ / std::to_string(of) / path;
}

UploadState Uploads::state(const std::string& name, std::uint64_t of) {
  const fs::path path = safe_path(name);
  const std::lock_guard lock(mutex_);
  return state_of(path, of);
}

UploadState Uploads::state_of(const fs::path& path, std::uint64_t of) const {
  if (!is_there(input_ / path)) return {size_of(part_of(path, of)), false};
  if (size_of(input_ / path) != of)
    throw UsageError(
        shown_word(path.string()) +
        " is there already with another content; rename the new one and drop it again");
  return {of, true};
}

UploadState Uploads::take(const std::string& name, std::uint64_t at, std::uint64_t of,
                          const std::string& bytes) {
  const fs::path path = safe_path(name), part = part_of(path, of), file = input_ / path;
  const std::lock_guard lock(mutex_);
  if (!is_there(project_)) throw UsageError("this project was removed");
  const UploadState there = state_of(path, of);
  if (there.is_whole || there.bytes != at) return there;
  if (at > of || bytes.size() > of - at)
    throw UsageError(shown_word(name) + " is longer than was said; drop it again");
  if (!use_) count();
  check_room(at == 0 ? of : bytes.size(), at == 0 ? 1 : 0);
  append(part, bytes);
  use_->bytes += bytes.size();
  use_->files += at == 0 ? 1 : 0;
  if (at + bytes.size() < of) return {at + bytes.size(), false};
  if (lowercase_ending(path) == ".zip") {
    unpack(part);
    fs::remove(part);
    count();
  } else {
    finish(part, file);
  }
  return {of, true};
}

void Uploads::count() {
  use_ = Use();
  for (const fs::path& folder : {input_, parts_}) {
    std::error_code none;
    for (const auto& entry : fs::recursive_directory_iterator(folder, none)) {
      if (!entry.is_regular_file(none)) continue;
      ++use_->files;
      use_->bytes += entry.file_size(none);
    }
  }
}

void Uploads::check_room(std::uint64_t more_bytes, std::size_t more_files) const {
  if (use_->files + more_files > limits_.files)
    throw NoRoom(
        fmt::format("a project takes {} files at most; begin another one, or type the folder "
                    "where the files lie",
                    limits_.files));
  if (use_->bytes + more_bytes > limits_.bytes)
    throw NoRoom(
        fmt::format("a project takes {:.3g} GiB at most; type the folder where the files lie",
                    double(limits_.bytes) / double(1 << 30)));
  fs::create_directories(parts_);
  if (fs::space(parts_).available < limits_.free_bytes + more_bytes)
    throw NoRoom(
        "the disk is full; free some space and drop the files again: what has arrived stays");
}

void Uploads::unpack(const fs::path& archive) {
  const fs::path name = archive.filename();
  try {
    const MappedFile zip(archive);
    auto entries = packed_entries(name, zip.bytes());
    std::erase_if(entries, [](const auto& entry) { return is_clutter(entry.first); });
    const std::string top = top_folder_of(entries);
    for (const auto& [entry, packed] : entries) {
      const fs::path file = input_ / safe_path(entry.substr(top.size()));
      if (is_there(file)) continue;
      if (packed.bytes > kLargestEntry)
        throw UsageError(
            fmt::format("{} in {} is too large to be unpacked here; unpack it and drop its files",
                        shown_word(entry), name.string()));
      check_room(packed.bytes, 1);
      AtomicFile out(file);
      out.write(unpacked(name, entry, packed));
      out.commit();
      use_->bytes += packed.bytes;
      ++use_->files;
    }
  } catch (const NoRoom&) {  // it can go on once there is room
    throw;
  } catch (const Error&) {
    fs::remove(archive);
    throw;
  }
}

}  // namespace gs
