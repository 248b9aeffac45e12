// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/photo_list.h"

#include <spdlog/fmt/fmt.h>

#include <map>
#include <string_view>

#include "data_loaders/photos/photo_names.h"
#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kLargestList = std::uint64_t(64) << 20;  // bytes, a million names

/// The names in a list, and whether a photo has each of them.
using ListedNames = std::map<std::string, bool, std::less<>>;

ListedNames read_names(const fs::path& file) {
  const std::string text = read_text_file(file, kLargestList);
  ListedNames names;
  for (std::string_view rest = text; !rest.empty();) {
    std::string_view line = rest.substr(0, rest.find('\n'));
    rest.remove_prefix(std::min(line.size() + 1, rest.size()));
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ' || line.back() == '/'))
      line.remove_suffix(1);
    if (!line.empty() && line.front() != '#') names.emplace(line, false);
  }
  return names;
}

// Notes the name as that of a photo. True if the list has it.
bool find(ListedNames& listed, std::string_view name) {
  const auto found = listed.find(name);
  if (found == listed.end()) return false;
  return found->second = true;
}

bool is_listed(ListedNames& listed, const std::string& name) {
  bool is_in = find(listed, name);
  is_in |= find(listed, without_extension(name));
  for (std::size_t end = name.find('/'); end != name.npos; end = name.find('/', end + 1))
    is_in |= find(listed, std::string_view(name).substr(0, end));
  return is_in;
}

}  // namespace

std::vector<bool> photos_in_list(const fs::path& file, const std::vector<std::string>& names) {
  ListedNames listed = read_names(file);
  if (listed.empty())
    throw Error("dataset.photo_list " + file.string() +
                " holds no name of a photo; write one a line, or leave the setting empty");
  std::vector<bool> is_in;
  for (const std::string& name : names) is_in.push_back(is_listed(listed, name));
  for (const auto& [name, is_found] : listed)
    if (!is_found)
      throw Error(
          fmt::format("dataset.photo_list {} has {}, but no image of the scene has this name{}; "
                      "remove the line "
                      "or name the scene that the list was made for",
                      file.string(), shown_word(name),
                      names.empty() ? "" : "; the first image is " + shown_word(names.front())));
  return is_in;
}

void write_photo_list(const fs::path& file, const std::vector<std::string>& names) {
  AtomicFile out(file);
  for (const std::string& name : names) out.write(name + "\n");
  out.commit();
}

}  // namespace gs
