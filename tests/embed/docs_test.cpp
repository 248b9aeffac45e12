// SPDX-License-Identifier: Apache-2.0
// docs/reference/cpp.md shows the installed example: its C++ is in that file, line for line.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/temp_folder.h"

namespace gs {
namespace {

std::string source_file(const std::string& name) {
  return read_bytes(std::filesystem::path(GS_SOURCE_DIR) / name);
}

// The text between ```LANGUAGE and ```.
std::vector<std::string> blocks_of(const std::string& text, const std::string& language) {
  const std::string begin = "\n```" + language + "\n", end = "\n```";
  std::vector<std::string> blocks;
  for (std::size_t at = 0; (at = text.find(begin, at)) != text.npos;) {
    at += begin.size();
    blocks.push_back(text.substr(at, text.find(end, at) - at) + "\n");
  }
  return blocks;
}

void expect_blocks_in(const std::string& language, const std::string& file) {
  const std::vector<std::string> blocks = blocks_of(source_file("docs/reference/cpp.md"), language);
  ASSERT_EQ(blocks.size(), 1u);
  EXPECT_NE(source_file(file).find(blocks[0]), std::string::npos) << file << " does not hold\n"
                                                                  << blocks[0];
}

TEST(EmbeddingDocs, TheCppIsThatOfTheExample) {
  expect_blocks_in("cpp", "examples/embed_cpp/main.cpp");
}

TEST(EmbeddingDocs, TheExampleFindsThePackageAsTheDocsSay) {
  const std::string example = source_file("examples/embed_cpp/CMakeLists.txt");
  const auto blocks = blocks_of(source_file("docs/reference/cpp.md"), "cmake");
  ASSERT_EQ(blocks.size(), 1u);
  std::string expected = blocks[0];
  expected.replace(expected.find("my_program"), 10, "gemsplat_example");
  for (std::size_t at = 0, end; (end = expected.find('\n', at)) != expected.npos; at = end + 1)
    EXPECT_NE(example.find(expected.substr(at, end - at)), std::string::npos)
        << expected.substr(at, end - at);
}

}  // namespace
}  // namespace gs
