// SPDX-License-Identifier: Apache-2.0
// What the targets of this folder share. A target gives bytes of a stranger to readers. A reader may
// return or throw Error; any other exception, a signal, a report of a sanitizer, more than 5 s or too
// much memory is a finding.
#pragma once

#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "gs_core/error.h"
#include "tests/support/temp_folder.h"

namespace gs::fuzz {

struct Target {
  const char* name;  // of its file and of its folder in corpus/
  void (*read)(std::string_view bytes);
};

/// The targets that are linked into this program.
inline std::vector<Target>& targets() {
  static std::vector<Target> all;
  return all;
}

/// `const Registered registered{"ply", read};` at the end of a target's file.
struct Registered {
  Registered(const char* name, void (*read)(std::string_view)) {
    targets().push_back({name, read});
  }
};

/// States what must hold for every input.
inline void require(bool holds, const char* what) {
  if (!holds) throw std::logic_error(what);
}

/// Calls a reader. Returns whether it took its input.
template <class Read>
bool takes(Read&& read) {
  try {
    read();
    return true;
  } catch (const Error& error) {
    const std::string said = error.what();
    require(said.size() >= 10, "an error says nothing");
    require(said == printable(said), "an error is not fit for a terminal");
    return false;
  }
}

/// A folder for the readers that take a path; there is one in each process. scripts/fuzz.sh sets
/// TMPDIR to a folder in memory.
inline const std::filesystem::path& folder() {
  static const TempFolder temp;
  return temp.path();
}

/// A file in the folder, whose path may lead through folders that exist.
inline std::filesystem::path file_of(const std::string& name, std::string_view bytes) {
  std::filesystem::path file = folder() / name;
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream.write(bytes.data(), std::streamsize(bytes.size()));
  require(bool(stream.flush()), "a file for a reader cannot be written");
  return file;
}

/// Stands between the files of an input that stands for several.
inline constexpr std::string_view kNextFile = "\n~~~~\n";

/// Writes the files of such an input under these names. Those that the input lacks are removed, and
/// the last name gets all that is left.
inline void write_files(std::string_view bytes, const std::vector<std::string>& names) {
  bool has_more = true;
  for (const std::string& name : names) {
    if (!has_more) {
      std::filesystem::remove(folder() / name);
      continue;
    }
    const bool is_last = &name == &names.back();
    const std::size_t end = is_last ? bytes.npos : bytes.find(kNextFile);
    file_of(name, bytes.substr(0, end));
    has_more = end != bytes.npos;
    if (has_more) bytes.remove_prefix(end + kNextFile.size());
  }
}

}  // namespace gs::fuzz
