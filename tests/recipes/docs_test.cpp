// SPDX-License-Identifier: Apache-2.0
// docs/develop/extending.md shows code that is compiled: each block stands word for word in the
// file that the comment above it names.
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/temp_folder.h"

namespace gs {
namespace {

struct Block {
  std::string file;  // of `<!-- from FILE -->`; empty: none is named
  std::string code;
  int line;
};

std::string source_file(const std::string& name) {
  return read_bytes(std::filesystem::path(GS_SOURCE_DIR) / name);
}

std::vector<Block> blocks_of(const std::string& page) {
  std::istringstream lines(source_file(page));
  std::vector<Block> blocks;
  std::string line, file;
  bool is_inside = false;
  for (int number = 1; std::getline(lines, line); ++number) {
    const std::string kFrom = "<!-- from ";
    if (line.starts_with(kFrom)) file = line.substr(kFrom.size(), line.find(" -->") - kFrom.size());
    if (line.starts_with("```")) {
      if (!is_inside) blocks.push_back({file, "", number});
      if (is_inside) file.clear();
      is_inside = !is_inside;
    } else if (is_inside) {
      blocks.back().code += line + "\n";
    }
  }
  return blocks;
}

TEST(ExtendingDocs, EveryBlockStandsInTheFileThatItNames) {
  const std::vector<Block> blocks = blocks_of("docs/develop/extending.md");
  EXPECT_GE(blocks.size(), 9u);
  for (const Block& block : blocks) {
    ASSERT_NE(block.file, "") << "docs/develop/extending.md:" << block.line << " names no file";
    EXPECT_NE(source_file(block.file).find(block.code), std::string::npos)
        << "docs/develop/extending.md:" << block.line << ": " << block.file << " does not hold\n"
        << block.code;
  }
}

}  // namespace
}  // namespace gs
