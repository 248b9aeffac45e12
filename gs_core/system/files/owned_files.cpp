// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/files/owned_files.h"

#include <spdlog/fmt/fmt.h>
#include <stdlib.h>
#include <sys/stat.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/move_aside.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kWorkFolder = ".gemsplat-";
constexpr std::size_t kRandomLetters = 6;  // of mkdtemp

bool stays_inside(const std::string& name) {
  const fs::path path(name);
  return !name.empty() && path.is_relative() && path.lexically_normal() == path &&
         path.has_filename() && std::none_of(path.begin(), path.end(), [](const fs::path& part) {
           return part == ".." || part == ".";
         });
}

bool have_same_bytes(const fs::path& a, const fs::path& b) {
  std::error_code error;
  if (fs::equivalent(a, b, error)) return true;  // hard links
  if (!fs::is_regular_file(a, error) || fs::file_size(a, error) != fs::file_size(b, error) || error)
    return false;
  std::ifstream first(a, std::ios::binary), second(b, std::ios::binary);
  char blocks[2][1 << 14];
  while (first && second) {
    first.read(blocks[0], sizeof blocks[0]);
    second.read(blocks[1], sizeof blocks[1]);
    const auto bytes = first.gcount();
    if (bytes != second.gcount() || std::memcmp(blocks[0], blocks[1], std::size_t(bytes)) != 0)
      return false;
  }
  return first.eof() && second.eof();
}

// Gives `to` the content of `from`, with its time of change; never replaces anything.
std::error_code link_or_copy(const fs::path& from, const fs::path& to,
                             const std::function<fs::path()>& work) {
  std::error_code error;
  fs::create_hard_link(from, to, error);
  if (!error || error == std::errc::file_exists) return error;
  const fs::path copy = work() / "copy";
  fs::copy_file(from, copy, fs::copy_options::overwrite_existing, error);
  if (!error) fs::last_write_time(copy, fs::last_write_time(from, error), error);
  return error ? error : rename_to_new(copy, to);
}

}  // namespace

std::string stamp_of(const fs::path& file) {
  struct stat status;
  if (::lstat(file.c_str(), &status) != 0) return "";
  return fmt::format("{} {}{:09}", status.st_size, status.st_mtim.tv_sec, status.st_mtim.tv_nsec);
}

OwnedFiles::OwnedFiles(fs::path folder, const Stamps& files, Save save)
    : folder_(std::move(folder)), save_(std::move(save)) {
  for (const auto& [name, stamp] : files)
    if (stays_inside(name)) files_[name] = stamp;
}

// A folder that was replaced by a link leads to files that are not ours.
bool OwnedFiles::is_reached_without_links(const std::string& name) const {
  std::error_code ignored;
  for (fs::path above = fs::path(name).parent_path(); !above.empty(); above = above.parent_path())
    if (fs::is_symlink(folder_ / above, ignored)) return false;
  return true;
}

bool OwnedFiles::holds(const std::string& name) const {
  const auto file = files_.find(name);
  return file != files_.end() && is_there(path(name)) && is_reached_without_links(name) &&
         (file->second.empty() || file->second == stamp_of(path(name)));
}

void OwnedFiles::refuse(const std::string& name) const {
  throw UsageError(
      fmt::format("{} is there, and is not of this reconstruction, so it is left alone; move it "
                  "away, or choose "
                  "another folder with -o",
                  path(name).string()));
}

void OwnedFiles::claim(const Stamps& files) {
  for (const auto& [name, stamp] : files)
    if (is_there(path(name)) && !holds(name)) refuse(name);
  for (const auto& [name, stamp] : files) files_[name] = stamp;
  save_(files_);
}

void OwnedFiles::place(const std::map<std::string, fs::path>& sources,
                       const std::function<fs::path()>& work) {
  Stamps missing;
  for (const auto& [name, source] : sources) {
    const std::string stamp = stamp_of(source);
    if (!is_there(path(name)))
      missing[name] = stamp;
    else if (!(holds(name) && files_.at(name) == stamp) && !have_same_bytes(path(name), source))
      refuse(name);
  }
  if (missing.empty()) return;
  claim(missing);
  bool are_times_kept = true;
  for (const auto& [name, stamp] : missing) {
    std::error_code error;
    fs::create_directories(path(name).parent_path(), error);
    if (!error) error = link_or_copy(sources.at(name), path(name), work);
    if (error)
      throw Error(
          fmt::format("cannot copy {} to {}: {}; free some space or choose another folder with -o",
                      sources.at(name).string(), path(name).string(), error.message()));
    // Some file systems round the time of a copy.
    if (const std::string made = stamp_of(path(name)); made != stamp) {
      files_[name] = made;
      are_times_kept = false;
    }
  }
  if (!are_times_kept) save_(files_);
}

void OwnedFiles::forget(const std::string& beginning) {
  if (std::erase_if(files_, [&](const auto& file) { return file.first.starts_with(beginning); }))
    save_(files_);
}

void OwnedFiles::remove_all() {
  std::error_code ignored;
  for (const auto& [name, stamp] : files_) {
    if (!holds(name)) continue;
    fs::remove(path(name), ignored);
    for (fs::path above = fs::path(name).parent_path(); !above.empty(); above = above.parent_path())
      if (!fs::remove(folder_ / above, ignored)) break;  // it holds other files
  }
  files_.clear();
  save_(files_);
}

fs::path make_work_folder(const fs::path& parent) {
  std::string name = (parent / (std::string(kWorkFolder) + "XXXXXX")).string();
  if (!::mkdtemp(name.data()))
    throw Error(fmt::format("cannot make a folder in {}: {}; choose another with -o",
                            parent.string(), std::strerror(errno)));
  return name;
}

bool is_work_folder(const std::string& name) {
  return name.size() == kWorkFolder.size() + kRandomLetters && name.starts_with(kWorkFolder) &&
         std::all_of(name.begin() + kWorkFolder.size(), name.end(),
                     [](unsigned char c) { return std::isalnum(c); });
}

bool remove_work_folder(const fs::path& folder) {
  GS_CHECK(is_work_folder(folder.filename().string()));
  std::error_code error;
  fs::remove_all(folder, error);
  return !is_there(folder);
}

}  // namespace gs
