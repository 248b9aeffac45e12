// SPDX-License-Identifier: Apache-2.0
// JSON and TOML of strangers: deep, large, of other types, or no regular files at all. Each ends in
// an Error that names the file.
#include <sys/stat.h>
#include <unistd.h>

#include "gs_core/config/config.h"
#include "gs_core/config/text/read_toml.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

std::string repeated(const std::string& text, std::size_t times) {
  std::string all;
  all.reserve(text.size() * times);
  for (std::size_t i = 0; i < times; ++i) all += text;
  return all;
}

class SmallFiles : public ::testing::Test {
 protected:
  std::string json_error(const std::string& text) {
    write_bytes(file(), text);
    return error_of([&] { read_json(file()); });
  }
  fs::path file() const { return folder_.path() / "results.json"; }
  fs::path toml() const { return folder_.path() / "a.toml"; }

 private:
  TempFolder folder_;
};

TEST_F(SmallFiles, JsonThatNestsDeepIsRefusedBeforeItIsParsed) {
  for (const char* open : {"[", "{\"a\":"})
    EXPECT_THAT(json_error("{\"x\":" + repeated(open, 60'000)),
                AllOf(HasSubstr("results.json"), HasSubstr("deeper than 64 levels")));
  EXPECT_THAT(json_error("{\"x\":\"" + std::string(100'000, '[')), HasSubstr("not JSON"));
}

TEST_F(SmallFiles, JsonInWhichQuotesAreEscapedIsMeasuredRightly) {
  write_bytes(file(), R"({"a": "[[[[\"[[[{{\\", "b": [[1]]})");
  EXPECT_EQ(read_json(file()).at("b")[0][0], 1);
  EXPECT_THAT(json_error("{\"a\": \"\\\"\", \"b\":" + repeated("[", 1000)), HasSubstr("deeper"));
}

TEST_F(SmallFiles, JsonOfMillionsOfEmptyListsIsRefusedBeforeItIsParsed) {
  EXPECT_THAT(json_error("{\"x\":[" + repeated("[],", 4 << 20) + "0]}"),
              HasSubstr("too many values"));
  EXPECT_THAT(json_error("{\"x\":[" + repeated("0,", 16 << 20) + "0]}"),
              HasSubstr("too many values"));
}

TEST_F(SmallFiles, AnObjectOfAMillionKeysIsRefusedBeforeItIsParsed) {
  std::string text = "{\"x\":0";
  for (int i = 0; i < 1'000'000; ++i) text += ",\"" + std::to_string(i) + "\":0";
  EXPECT_THAT(json_error(text + "}"), HasSubstr("too many values"));
}

TEST_F(SmallFiles, ThousandsOfKeysAreRead) {
  std::string text = "{\"x\":0";
  for (int i = 0; i < 5000; ++i) text += ",\"view " + std::to_string(i) + ".jpg\":{\"psnr\":30.5}";
  write_bytes(file(), text + "}");
  EXPECT_EQ(read_json(file()).size(), 5001u);
}

TEST_F(SmallFiles, AValueOfAnotherTypeIsAnErrorThatNamesTheFile) {
  const Json json = {{"a", "text"}};
  const auto take = [&](const char* key) {
    return error_of(
        [&] { take_from_json(file(), "train again", [&] { return json.at(key).get<int>(); }); });
  };
  for (const char* key : {"a", "missing"})
    EXPECT_THAT(take(key), AllOf(HasSubstr("results.json"), HasSubstr("another form"),
                                 HasSubstr("train again"), Not(HasSubstr("json.exception"))));
}

TEST_F(SmallFiles, ATooLargeFileIsRefusedBeforeItIsRead) {
  write_bytes(file(), "{}");
  fs::resize_file(file(), kLargestJson + 1);  // sparse
  EXPECT_THAT(error_of([&] { read_json(file()); }), HasSubstr("too many for a file of this kind"));
  write_bytes(toml(), "");
  fs::resize_file(toml(), 2 << 20);
  EXPECT_THAT(error_of([&] { read_toml_text(toml()); }), HasSubstr("too many for a file"));
}

TEST_F(SmallFiles, FifosAndDevicesAreRefusedAtOnce) {
  ASSERT_EQ(mkfifo(file().c_str(), 0600), 0);
  EXPECT_THAT(error_of([&] { read_json(file()); }), HasSubstr("not a regular file"));
  Config config;
  EXPECT_THAT(error_of([&] { load_config(config, file()); }), HasSubstr("not a regular file"));
  EXPECT_THAT(error_of([&] { read_text_file("/dev/zero", 100); }), HasSubstr("not a regular file"));
}

// As in `train -c <(cat c.toml)`: the config is asked for several times.
TEST_F(SmallFiles, APipeOfTheShellGivesItsTextEachTime) {
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  ASSERT_EQ(::write(ends[1], "a = 1", 5), 5);
  ::close(ends[1]);
  const fs::path pipe = "/dev/fd/" + std::to_string(ends[0]);
  EXPECT_TRUE(is_pipe_of_shell(pipe));
  EXPECT_EQ(read_text_file(pipe, 100), "a = 1");
  EXPECT_EQ(read_text_file(pipe, 100), "a = 1");
  ::close(ends[0]);
}

TEST_F(SmallFiles, TomlThatNestsDeepIsRefusedBeforeItIsParsed) {
  for (const std::string& text :
       {"a" + repeated(".a", 100'000) + " = 1", "[a" + repeated(".a", 100'000) + "]",
        "a = " + repeated("[", 100'000), "a = " + repeated("{a=", 100'000),
        "a" + repeated(" . \"a\"", 100'000) + " = 1"}) {
    write_bytes(toml(), "\n" + text);
    Config config;
    EXPECT_THAT(error_of([&] { load_config(config, toml()); }),
                AllOf(HasSubstr("a.toml:2: "), HasSubstr("deeper than 32")));
  }
  Config config;
  EXPECT_THAT(
      error_of([&] { apply_setting(config, "train.iterations=" + repeated("[", 100'000)); }),
      HasSubstr("cannot be used"));
}

TEST_F(SmallFiles, ABraceThatClosesAListInTomlIsRefused) {
  write_bytes(toml(), "# as a fuzz target found\na = {b = [1, }\n");
  Config config;
  EXPECT_THAT(error_of([&] { load_config(config, toml()); }), HasSubstr("a.toml:2: a } closes a"));
  EXPECT_EQ(parse_toml("a = [{b = [1, '}']}, {}]", "here")["a"].as_array()->size(), 2u);
}

TEST_F(SmallFiles, LettersBeyondAsciiInTomlNeedQuotes) {
  for (const char* text : {"gr\u00f6\u00dfe = 1", "a = gr\u00f6\u00dfe", "[gr\u00f6\u00dfe]"}) {
    write_bytes(toml(), text);
    Config config;
    EXPECT_THAT(error_of([&] { load_config(config, toml()); }), HasSubstr("a.toml:1: ")) << text;
  }
  const toml::table table =
      parse_toml("\xEF\xBB\xBF\"gr\u00f6\u00dfe\" = '\u00e9' # \u00e9", "here");
  EXPECT_EQ(table["gr\u00f6\u00dfe"].value<std::string>(), "\u00e9");
}

TEST_F(SmallFiles, DotsInStringsNumbersAndCommentsNestNothing) {
  const std::string dots(1000, '.');
  const std::string text = "# " + dots + "\na = \"" + dots + "\\\"" + dots + "\"\nb = '" + dots +
                           "'\nc = \"\"\"\n" + dots + "\n\"\"\"\nd = [" + repeated("1.5, ", 1000) +
                           "2.5]\n";
  const toml::table table = parse_toml(text, "here");
  EXPECT_EQ(table["d"].as_array()->size(), 1001u);
}

TEST_F(SmallFiles, AnEmptyTableWithASlipOfThePenIsRefused) {
  write_bytes(toml(), "[trian]\n");
  Config config;
  EXPECT_THAT(error_of([&] { load_config(config, toml()); }), HasSubstr("no setting trian"));
  write_bytes(toml(), "[train]\n");
  load_config(config, toml());
}

TEST_F(SmallFiles, AHugeValueIsToldTheLargestOne) {
  Config config;
  EXPECT_THAT(error_of([&] { apply_setting(config, "dataset.photo_ram_gib=1e300"); }),
              HasSubstr("from 0 to 1048576"));
  EXPECT_THAT(error_of([&] { apply_setting(config, "optimizer.sh0_lr=1e300"); }),
              HasSubstr("at most 3.4e+38"));
}

TEST_F(SmallFiles, AFolderThatCannotBeListedIsNotTakenForAnEmptyOne) {
  const TempFolder temp;
  EXPECT_TRUE(entries_of(temp.path() / "nothing").empty());
  fs::create_symlink("loop", temp.path() / "loop");
  EXPECT_THROW(entries_of(temp.path() / "loop"), AccessError);
}

TEST_F(SmallFiles, AKeyOfThousandsOfBytesIsNotRepeatedWhole) {
  write_bytes(toml(), "[train]\n" + std::string(100'000, 'k') + " = 1\n");
  Config config;
  EXPECT_LT(error_of([&] { load_config(config, toml()); }).size(), 600u);
}

}  // namespace
}  // namespace gs
