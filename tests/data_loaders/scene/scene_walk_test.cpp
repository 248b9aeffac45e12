// SPDX-License-Identifier: Apache-2.0
// data_loaders/scene/README.md lists the files that a photo passes on its way to a View. This test
// checks that the list is short and complete: each source file that load_scene.cpp reaches by
// includes is in it.
#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestWalk = 20;  // files

const fs::path kRoot = fs::path(GS_SOURCE_DIR) / "data_loaders";

std::string text_of(const fs::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// The quoted includes of a file that begin with data_loaders/, without this prefix.
std::vector<std::string> includes_of(const fs::path& file) {
  static const std::regex kInclude("#include \"data_loaders/([^\"]+)\"");
  const std::string text = text_of(file);
  std::vector<std::string> names;
  for (std::sregex_iterator at(text.begin(), text.end(), kInclude), end; at != end; ++at)
    names.push_back((*at)[1]);
  return names;
}

/// The source files reached from one: a header leads to the source file of its name.
std::set<std::string> sources_reached_from(const std::string& source) {
  std::set<std::string> seen, sources;
  std::vector<std::string> open = {source};
  while (!open.empty()) {
    const std::string file = open.back();
    open.pop_back();
    if (!fs::exists(kRoot / file) || !seen.insert(file).second) continue;
    if (file.ends_with(".cpp")) sources.insert(file);
    for (const std::string& included : includes_of(kRoot / file)) open.push_back(included);
    open.push_back(fs::path(file).replace_extension(".cpp").string());
  }
  return sources;
}

struct Walk {
  std::vector<std::string> files, detours;  // a detour ends with "/" if it is a whole folder
};

Walk walk_in_readme() {
  const std::string text = text_of(kRoot / "scene/README.md");
  const std::size_t detours = text.find("Detours");
  EXPECT_NE(detours, text.npos);
  static const std::regex kName("[a-z_]+/[a-z_/]*(\\.cpp)?");
  Walk walk;
  const std::size_t first = text.find("1. ");
  for (std::sregex_iterator at(text.begin() + std::ptrdiff_t(first), text.end(), kName), end;
       at != end; ++at) {
    const bool is_detour = first + std::size_t(at->position()) > detours;
    (is_detour ? walk.detours : walk.files).push_back(at->str());
  }
  return walk;
}

TEST(SceneWalk, EntersAFewFilesThatExist) {
  const Walk walk = walk_in_readme();
  EXPECT_LE(walk.files.size(), kLongestWalk);
  EXPECT_EQ(std::set(walk.files.begin(), walk.files.end()).size(), walk.files.size());
  for (const std::string& file : walk.files) EXPECT_TRUE(fs::is_regular_file(kRoot / file)) << file;
  for (const std::string& detour : walk.detours) EXPECT_TRUE(fs::exists(kRoot / detour)) << detour;
}

TEST(SceneWalk, ListsEveryFileThatLoadingReaches) {
  const Walk walk = walk_in_readme();
  const std::set<std::string> reached = sources_reached_from("scene/load_scene.cpp");
  EXPECT_GE(reached.size(), kLongestWalk);
  for (const std::string& file : reached) {
    bool is_listed = std::find(walk.files.begin(), walk.files.end(), file) != walk.files.end();
    for (const std::string& detour : walk.detours)
      is_listed |= detour.ends_with("/") ? file.starts_with(detour) : file == detour;
    EXPECT_TRUE(is_listed) << file << " is on the way, but not in data_loaders/scene/README.md";
  }
}

}  // namespace
}  // namespace gs
