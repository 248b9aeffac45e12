// SPDX-License-Identifier: Apache-2.0
// Files that strangers send to the studio: uploads that are interrupted, hostile names and archives,
// and a full disk.
#include <gmock/gmock.h>
#include <sys/resource.h>

#include "gs_app/studio/uploads.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/processes/signals.h"
#include "gs_model/formats/coding/zip_file.h"
#include "tests/support/error_of.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(StudioUploads, GoOnWhereTheyWereInterrupted) {
  const TempFolder folder;
  {
    Uploads uploads(folder.path());
    EXPECT_EQ(uploads.take("a/b.jpg", 0, 6, "abc").bytes, 3u);
  }
  Uploads again(folder.path());
  EXPECT_EQ(again.state("a/b.jpg", 6).bytes, 3u);
  EXPECT_EQ(again.take("a/b.jpg", 0, 6, "abc").bytes, 3u);  // passed over: it is there
  EXPECT_FALSE(fs::exists(folder.path() / "input/a/b.jpg"));
  EXPECT_TRUE(again.take("a/b.jpg", 3, 6, "def").is_whole);
  EXPECT_EQ(read_bytes(folder.path() / "input/a/b.jpg"), "abcdef");
  EXPECT_TRUE(again.state("a/b.jpg", 6).is_whole);
  EXPECT_THAT(error_of([&] { again.take("a/b.jpg", 0, 7, "1234567"); }),
              HasSubstr("another content"));
  EXPECT_EQ(read_bytes(folder.path() / "input/a/b.jpg"), "abcdef");
}

TEST(StudioUploads, HaveLimitsThatLoseNothing) {
  const TempFolder folder;
  Uploads uploads(folder.path(), {.bytes = 100, .free_bytes = 0, .files = 3});
  uploads.take("1", 0, 4, "1234");
  EXPECT_THROW(uploads.take("2", 0, 2, "123"), UsageError);  // longer than was said
  EXPECT_THAT(error_of([&] { uploads.take("2", 0, 200, "12"); }), HasSubstr("at most"));
  uploads.take("2", 0, 1, "1");
  uploads.take("3", 0, 1, "1");
  EXPECT_THAT(error_of([&] { uploads.take("4", 0, 1, "1"); }), HasSubstr("3 files at most"));
  EXPECT_EQ(read_bytes(folder.path() / "input/1"), "1234");
  Uploads full(folder.path(), {.bytes = 100, .free_bytes = std::uint64_t(1) << 60, .files = 10});
  EXPECT_THAT(error_of([&] { full.take("4", 0, 1, "1"); }), HasSubstr("the disk is full"));
}

TEST(StudioUploads, KeepWhatHasArrivedWhereTheDiskIsFull) {
  ignore_file_size_signal();
  const TempFolder folder;
  Uploads uploads(folder.path());
  uploads.take("a", 0, 300'000, std::string(100'000, 'a'));
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{150'000, before.rlim_max};  // bytes of the largest file
  setrlimit(RLIMIT_FSIZE, &small);
  const std::string error =
      error_of([&] { uploads.take("a", 100'000, 300'000, std::string(100'000, 'b')); });
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_THAT(error, HasSubstr("what has arrived stays"));
  const std::uint64_t there = uploads.state("a", 300'000).bytes;
  EXPECT_GE(there, 100'000u);
  EXPECT_TRUE(uploads.take("a", there, 300'000, std::string(300'000 - there, 'b')).is_whole);
}

TEST(StudioUploads, UnpackArchivesWithoutLeavingTheirFolder) {
  const TempFolder folder;
  Uploads uploads(folder.path());
  const auto drop = [&](const std::string& name, const std::string& zip) {
    return uploads.take(name, 0, zip.size(), zip);
  };
  const std::string fox = zip_of({{"fox/images/a.jpg", "aaa"},
                                  {"fox/sparse/0/cameras.txt", "c"},
                                  {"fox/images/", ""},
                                  {"__MACOSX/fox/images/._a.jpg", "x"},
                                  {"fox/images/.DS_Store", "x"}},
                                 true);
  EXPECT_TRUE(drop("fox.zip", fox).is_whole);
  EXPECT_EQ(read_bytes(folder.path() / "input/images/a.jpg"), "aaa");
  EXPECT_EQ(read_bytes(folder.path() / "input/sparse/0/cameras.txt"), "c");
  EXPECT_FALSE(fs::exists(folder.path() / "input/fox.zip"));
  EXPECT_TRUE(drop("two.zip", zip_of({{"a/1.jpg", "1"}, {"b/2.jpg", "2"}})).is_whole);
  EXPECT_EQ(read_bytes(folder.path() / "input/a/1.jpg"), "1");
  EXPECT_FALSE(fs::exists(folder.path() / "input/images/.DS_Store"));
  EXPECT_THROW(drop("evil.zip", zip_of({{"../../evil", "x"}})), UsageError);
  EXPECT_FALSE(fs::exists(folder.path().parent_path() / "evil"));
  EXPECT_THROW(drop("bad.zip", "PK no zip"), Error);
  EXPECT_EQ(uploads.state("bad.zip", 9).bytes, 0u);  // a better one can come
}

TEST(StudioUploads, UnpackNoNameThatLeadsElsewhere) {
  const TempFolder folder;
  fs::create_directories(folder.path() / "project");
  Uploads uploads(folder.path() / "project");
  for (const std::string& evil :
       {std::string("../../evil"), std::string("a/../../evil"), std::string("a//evil"),
        std::string("a\\evil"), std::string("a\0/evil", 7), std::string("1/2/3/4/5/6/7/8/evil"),
        std::string(300, 'e')}) {
    const std::string zip = zip_of({{evil, "x"}, {"photo", "y"}});
    EXPECT_THROW(uploads.take("evil.zip", 0, zip.size(), zip), Error) << evil;
  }
  const std::string absolute = zip_of({{"/evil", "x"}});  // a folder of the archive's own
  uploads.take("absolute.zip", 0, absolute.size(), absolute);
  for (const fs::path& file : {folder.path() / "evil", fs::path("/evil"), fs::path("evil")})
    EXPECT_FALSE(fs::exists(file)) << file;
  EXPECT_THAT(entries_of(folder.path()), ElementsAre(folder.path() / "project"));
}

// Gives the first entry of an archive another size than it has.
std::string with_size(std::string zip, std::uint32_t bytes) {
  constexpr std::size_t kSizeAt = 24;  // in the header of an entry in the directory
  for (int i = 0; i < 4; ++i) zip[zip.rfind("PK\1\2") + kSizeAt + i] = char(bytes >> (8 * i));
  return zip;
}

TEST(StudioUploads, UnpackNoMoreThanTheirLimits) {
  const TempFolder folder;
  constexpr std::uint64_t kMiB = 1 << 20;
  Uploads uploads(folder.path(), {.bytes = 3 * kMiB, .free_bytes = 0, .files = 10});
  const auto error_with = [&](const std::string& zip) {
    return error_of([&] { uploads.take("bomb.zip", 0, zip.size(), zip); });
  };
  const std::string one = zip_of({{"zeros", std::string(kMiB, '\0')}}, true);
  ASSERT_LT(one.size(), kMiB / 100);
  EXPECT_THAT(error_with(with_size(one, 3u << 30)), HasSubstr("too large to be unpacked"));
  EXPECT_THAT(error_with(with_size(one, 100)),
              HasSubstr("bomb.zip"));  // it holds more than it says
  EXPECT_FALSE(fs::exists(folder.path() / "input/zeros"));
  std::vector<ZipEntry> zeros;
  for (int i = 0; i < 8; ++i) zeros.push_back({std::to_string(i), std::string(kMiB, '\0')});
  EXPECT_THAT(error_with(zip_of(zeros, true)), HasSubstr("GiB at most"));
  EXPECT_THAT(entries_of(folder.path() / "input"),
              ElementsAre(folder.path() / "input/0", folder.path() / "input/1"));
}

TEST(StudioUploads, UnpackAgainWhereTheDiskWasFull) {
  ignore_file_size_signal();
  const TempFolder folder;
  Uploads uploads(folder.path());
  const std::string zip =
      zip_of({{"a", "small"}, {"b", std::string(1 << 20, 'b')}, {"c", "last"}}, true);
  const auto drop = [&] { return uploads.take("a.zip", 0, zip.size(), zip); };
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{100'000, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  const std::string error = error_of(drop);
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_THAT(error, HasSubstr("cannot write"));
  EXPECT_FALSE(fs::exists(folder.path() / "input/b"));
  EXPECT_TRUE(drop().is_whole);
  EXPECT_EQ(read_bytes(folder.path() / "input/a"), "small");
  EXPECT_EQ(fs::file_size(folder.path() / "input/b"), 1u << 20);
}

TEST(StudioUploads, CountTheFilesOfAnArchive) {
  const TempFolder folder;
  Uploads uploads(folder.path(), {.bytes = 1 << 20, .free_bytes = 0, .files = 4});
  std::vector<ZipEntry> many;
  for (int i = 0; i < 50; ++i) many.push_back({"p" + std::to_string(i), "x"});
  const std::string zip = zip_of(many);
  EXPECT_THAT(error_of([&] { uploads.take("many.zip", 0, zip.size(), zip); }),
              HasSubstr("4 files at most"));
  EXPECT_LE(entries_of(folder.path() / "input").size(), 4u);
}

}  // namespace
}  // namespace gs
