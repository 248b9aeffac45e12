// SPDX-License-Identifier: Apache-2.0
// Temporary files: their names cannot be guessed, and no link under such a name is followed.
#include "gs_core/system/files/atomic_file.h"

#include <unistd.h>

#include "tests/support/temp_folder.h"
#include "tests/support/test.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder))
    names.insert(entry.path().filename().string());
  return names;
}

TEST(AtomicFile, FollowsNoLinkThatWaitsUnderACountedName) {
  const TempFolder folder;
  write_bytes(folder.path() / "victim", "precious");
  const std::string process = std::to_string(::getpid());
  for (int i = 0; i < 1000; ++i)
    fs::create_symlink(folder.path() / "victim",
                       folder.path() / (".new.txt." + process + "." + std::to_string(i) + ".tmp"));
  AtomicFile file(folder.path() / "new.txt");
  file.write("text");
  file.commit();
  EXPECT_EQ(read_bytes(folder.path() / "victim"), "precious");
  EXPECT_EQ(read_bytes(folder.path() / "new.txt"), "text");
}

TEST(AtomicFile, TemporaryNamesHave64RandomBits) {
  const TempFolder folder;
  for (int i = 0; i < 2; ++i) make_temporary_beside(folder.path() / "a", ".tmp");
  const std::set<std::string> names = names_in(folder.path());
  ASSERT_EQ(names.size(), 2u);
  const std::string begin = ".a." + std::to_string(::getpid()) + ".";
  for (const std::string& name : names) {
    EXPECT_THAT(name, testing::StartsWith(begin));
    EXPECT_EQ(name.size(), begin.size() + 16 + 4) << name;
  }
  EXPECT_NE(names.begin()->substr(begin.size(), 8), names.rbegin()->substr(begin.size(), 8));
}

TEST(AtomicFile, LeavesNothingWithoutCommit) {
  const TempFolder folder;
  { AtomicFile(folder.path() / "a").write("text"); }
  EXPECT_TRUE(names_in(folder.path()).empty());
}

TEST(AtomicFile, ATemporaryFileForOthersIsNewAndEmpty) {
  const TempFolder folder;
  const fs::path made = make_temporary_beside(folder.path() / "film.mp4", ".mp4");
  EXPECT_EQ(made.parent_path(), folder.path());
  EXPECT_EQ(made.extension(), ".mp4");
  EXPECT_TRUE(fs::is_regular_file(made));
  EXPECT_TRUE(fs::is_empty(made));
  EXPECT_NE(make_temporary_beside(folder.path() / "film.mp4", ".mp4"), made);
}

}  // namespace
}  // namespace gs
