// SPDX-License-Identifier: Apache-2.0
// What may be moved aside, and the lock of a folder, which every path to the folder leads to.
#include <sys/wait.h>
#include <unistd.h>

#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/files/output_names.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

class Owned : public ::testing::Test {
 protected:
  Owned() {
    write_bytes(path("photos/a.jpg"), "photo a");
    write_bytes(path("photos/b.jpg"), "photo b");
    fs::create_directories(path("scene"));
  }
  fs::path path(const std::string& name) const { return folder_.path() / name; }

 private:
  TempFolder folder_;
};

// ---- moving aside -------------------------------------------------------------------------------

TEST_F(Owned, AFolderThatHoldsWhatIsNeededIsNotMoved) {
  fs::create_directory_symlink(path("photos"), path("link"));
  for (const char* needed : {"photos", "photos/", "photos/a.jpg", "link", "scene/../photos"})
    for (const char* folder : {"photos", "photos/.", "link", "link/", "scene/../photos", "."})
      EXPECT_THROW(check_may_move(path(folder), {path(needed)}), UsageError)
          << needed << " in " << folder;
  check_may_move(path("scene"), {path("photos"), path("no/such/file"), ""});
  EXPECT_THROW(check_may_move(fs::current_path(), {}), UsageError);
}

// ---- the lock -----------------------------------------------------------------------------------

// Whether another process would get the lock.
bool is_free(const fs::path& folder) {
  const pid_t child = ::fork();
  if (child == 0) {
    try {
      const OutputLock lock = OutputLock::of_folder(folder);
    } catch (const Error&) {
      ::_exit(1);
    }
    ::_exit(0);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return status == 0;
}

TEST_F(Owned, EveryPathToALockedFolderIsLocked) {
  fs::create_directory_symlink(path("scene"), path("link"));
  {
    const OutputLock lock = OutputLock::of_folder(path("link"));
    for (const char* name : {"scene", "scene/", "link", "link/", "link/.", "photos/../scene"})
      EXPECT_FALSE(is_free(path(name))) << name;
    for (const auto& entry : fs::directory_iterator(path("")))  // nothing is written above it
      EXPECT_FALSE(entry.path().filename().string().starts_with('.')) << entry.path();
  }
  EXPECT_TRUE(is_free(path("scene")));
  EXPECT_TRUE(fs::is_empty(path("scene")));
}

TEST_F(Owned, ALockLeavesNoFolderThatItHadToMake) {
  { const OutputLock lock = OutputLock::of_folder(path("new/folder")); }
  EXPECT_FALSE(fs::exists(path("new")));
  {
    const OutputLock lock = OutputLock::of_folder(path("new/folder/"));
    write_bytes(path("new/folder/result"), "x");
  }
  EXPECT_EQ(read_bytes(path("new/folder/result")), "x");
}

TEST_F(Owned, AFolderThatIsMovedAsideIsLockedInItsPlace) {
  write_bytes(path("scene/result"), "older");
  OutputLock lock = OutputLock::of_folder(path("scene"));
  EXPECT_EQ(lock.move_folder_aside({path("photos")}), path("scene.bak-1"));
  EXPECT_FALSE(is_free(path("scene")));
  EXPECT_EQ(read_bytes(path("scene.bak-1/result")), "older");
  EXPECT_EQ(std::distance(fs::directory_iterator(path("scene.bak-1")), {}), 1);
  EXPECT_THROW(lock.move_folder_aside({path("scene/photos")}), UsageError);
}

// ---- folders for a while -------------------------------------------------------------------------

/// Other tests have theirs at the same time, under another prefix.
constexpr const char* kPrefix = "gemsplat-owned-test-";

TEST_F(Owned, AScratchFolderThatAKillHasLeftIsRemovedByTheNextOne) {
  const fs::path note = path("name");
  const pid_t child = ::fork();
  if (child == 0) {
    const ScratchFolder scratch(kPrefix);
    write_bytes(scratch.path() / "model.rad", "large");
    write_bytes(note, scratch.path().string());
    ::kill(::getpid(), SIGKILL);
  }
  ::waitpid(child, nullptr, 0);
  const fs::path left = read_bytes(note);
  ASSERT_TRUE(fs::exists(left / "model.rad"));
  const ScratchFolder next(kPrefix);
  EXPECT_FALSE(fs::exists(left.parent_path()));
  EXPECT_TRUE(fs::is_empty(next.path()));
}

TEST_F(Owned, ARemovalOfAScratchFolderThatAKillHasCutOffIsFinished) {
  constexpr int kFiles = 600;  // their removal takes long enough for a kill
  const fs::path note = path("name");
  const auto files_in = [](const fs::path& folder) {
    std::error_code gone;
    return std::distance(fs::directory_iterator(folder, gone), fs::directory_iterator());
  };
  for (int time = 0; time < 6; ++time) {  // which file goes first is the file system's choice
    fs::remove(note);
    const pid_t child = ::fork();
    if (child == 0) {
      auto scratch = std::make_unique<ScratchFolder>(kPrefix);
      for (int i = 0; i < kFiles; ++i) write_bytes(scratch->path() / std::to_string(i), "");
      write_bytes(path("draft"), scratch->path().string());
      fs::rename(path("draft"), note);
      ::usleep(20'000);
      scratch.reset();
      ::_exit(0);
    }
    while (!fs::exists(note)) ::usleep(1000);
    const fs::path left = read_bytes(note);
    while (files_in(left) == kFiles) ::usleep(100);
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    { const ScratchFolder next(kPrefix); }
    EXPECT_FALSE(fs::exists(left)) << files_in(left) << " files are left";
    fs::remove_all(left.parent_path());
  }
}

TEST_F(Owned, AScratchFolderStaysWhileItsProcessLivesAndWhatIsNotOursAlways) {
  const ScratchFolder living(kPrefix);
  const fs::path users = fs::temp_directory_path() / (std::string(kPrefix) + "mything");
  const fs::path short_one = fs::temp_directory_path() / (std::string(kPrefix) + "result");
  write_bytes(users / "a.txt", "dear");
  write_bytes(short_one / "a.txt", "dear");  // as long as a name of ours
  { const ScratchFolder next(kPrefix); }
  EXPECT_TRUE(fs::exists(living.path()));
  EXPECT_EQ(read_bytes(users / "a.txt"), "dear");
  EXPECT_EQ(read_bytes(short_one / "a.txt"), "dear");
  fs::remove_all(users);
  fs::remove_all(short_one);
}

// ---- files that are being written ---------------------------------------------------------------

TEST_F(Owned, AKillWhileAFileIsWrittenLeavesNothingBehind) {
  write_bytes(path("scene/a.txt"), "older");
  const pid_t child = ::fork();
  if (child == 0) {
    AtomicFile file(path("scene/a.txt")), other(path("scene/b.txt"));
    file.write("newer");
    ::kill(::getpid(), SIGKILL);
  }
  ::waitpid(child, nullptr, 0);
  EXPECT_EQ(read_bytes(path("scene/a.txt")), "older");
  if (std::distance(fs::directory_iterator(path("scene")), {}) > 1)
    GTEST_SKIP() << "this file system has no files without names";
}

TEST_F(Owned, ALockRemovesWhatAKilledWriterOfItsOutputHasLeft) {
  constexpr const char* kOfDeadProcess = ".2147483646.0123456789abcdef.tmp";
  const fs::path ours = path(std::string(".a.ply") + kOfDeadProcess),
                 sidecar = path(std::string(".a.ply.transforms.json") + kOfDeadProcess),
                 other = path(std::string(".b.ply") + kOfDeadProcess), users = path(".a.ply.tmp");
  for (const fs::path& file : {ours, sidecar, other, users}) write_bytes(file, "x");
  { const OutputLock lock = OutputLock::of_file(path("a.ply")); }
  EXPECT_FALSE(fs::exists(ours));
  EXPECT_FALSE(fs::exists(sidecar));
  EXPECT_TRUE(fs::exists(other));
  { const OutputLock lock = OutputLock::of_folder(path(".")); }
  EXPECT_FALSE(fs::exists(other));
  EXPECT_TRUE(fs::exists(users));
}

TEST_F(Owned, AnOutputIsNamedOnceByAnyPath) {
  fs::create_directory_symlink(path("scene"), path("link"));
  write_bytes(path("scene/c.ply"), "older");
  fs::create_symlink(path("scene/c.ply"), path("d.ply"));
  OutputNames names;
  names.add_file(path("scene/a.ply"));
  EXPECT_THROW(names.add_file(path("scene/./a.ply")), UsageError);
  EXPECT_THROW(names.add_file(path("link/a.ply")), UsageError);
  names.add_file(path("d.ply"));
  EXPECT_THROW(names.add_file(path("scene/c.ply")), UsageError);
  names.add_file(path("scene/b.ply"));
}

TEST_F(Owned, NoOutputLiesInAFolderThatIsAnother) {
  OutputNames names;
  names.add_folder(path("tiles/"));
  names.add_file(path("a.ply"));
  for (const char* file : {"tiles", "tiles/a.ply", "tiles/0/0.glb"})
    EXPECT_THROW(names.add_file(path(file)), UsageError) << file;
  for (const char* folder : {"tiles", "tiles/0/", "", "a.ply/"})
    EXPECT_THROW(names.add_folder(path(folder)), UsageError) << folder;
  names.add_folder(path("tiles2"));
}

}  // namespace
}  // namespace gs
