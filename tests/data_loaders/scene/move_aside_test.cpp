// SPDX-License-Identifier: Apache-2.0
// Files and folders that are in the way of new ones are kept under another name.
#include "gs_core/system/files/move_aside.h"

#include <gtest/gtest.h>

#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Makes a replacement fail just before its final rename.
class FailingRename : public WriteHook {
 public:
  FailingRename() { set_write_hook(this); }
  ~FailingRename() override { set_write_hook(nullptr); }
  void before(WritePoint point, const fs::path&) override {
    if (point == WritePoint::rename) throw Error("the disk is full, says the test");
  }
};

class MoveAside : public testing::Test {
 protected:
  fs::path path(const char* name) const { return folder_.path() / name; }
  void replace(const fs::path& file, std::string_view text) {
    keep_aside(file);
    AtomicFile newer(file);
    newer.write(text);
    newer.commit();
  }

 private:
  TempFolder folder_;
};

TEST_F(MoveAside, AFolderGetsTheFirstFreeName) {
  write_bytes(path("runs/a/results.json"), "first");
  write_bytes(path("runs/a.bak-1/results.json"), "older");
  EXPECT_EQ(move_aside(path("runs/a/")), path("runs/a.bak-2"));
  EXPECT_FALSE(fs::exists(path("runs/a")));
  EXPECT_EQ(read_bytes(path("runs/a.bak-2/results.json")), "first");
}

TEST_F(MoveAside, AFileIsThereUntilTheNewerOneIsWhole) {
  write_bytes(path("a.ply"), "older");
  {
    const FailingRename hook;
    EXPECT_THROW(replace(path("a.ply"), "newer"), Error);
  }
  EXPECT_EQ(read_bytes(path("a.ply")), "older");
  EXPECT_EQ(read_bytes(path("a.ply.bak-1")), "older");

  replace(path("a.ply"), "newer");
  EXPECT_EQ(read_bytes(path("a.ply")), "newer");
  EXPECT_EQ(read_bytes(path("a.ply.bak-2")), "older");
}

TEST_F(MoveAside, WhatASymbolicLinkLeadsToIsKept) {
  write_bytes(path("elsewhere/b.ply"), "older");
  fs::create_symlink(path("elsewhere/b.ply"), path("a.ply"));
  replace(path("a.ply"), "newer");
  EXPECT_EQ(read_bytes(path("a.ply")), "newer");
  EXPECT_EQ(read_bytes(path("a.ply.bak-1")), "older");
}

}  // namespace
}  // namespace gs
