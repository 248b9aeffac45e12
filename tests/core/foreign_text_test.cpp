// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/text/foreign_text.h"

#include "tests/support/test.h"

namespace gs {
namespace {

TEST(ForeignText, PlainTextAndUtf8StayAsTheyAre) {
  const std::string text = "cannot read photos/Münster €.jpg\t(日本, 😀)\n  a block of ours";
  EXPECT_EQ(printable(text), text);
}

TEST(ForeignText, ControlCharactersAreEscaped) {
  EXPECT_EQ(printable("\x1b[2Ja\rb\x7f"), "\\x1b[2Ja\\rb\\x7f");
  EXPECT_EQ(printable("\xc2\x9b"
                      "31m"),
            "\\xc2\\x9b31m");  // CSI in eight bits
}

TEST(ForeignText, ALineOfOursCannotBeForged) {
  EXPECT_EQ(printable("a\nerror: forged"), "a\\nerror: forged");
  EXPECT_EQ(shown_word("a\n  b"), "a\\n  b");
}

TEST(ForeignText, MarksThatTurnTheWritingAreEscaped) {
  EXPECT_EQ(printable("a\u202egpj.exe"), "a\\xe2\\x80\\xaegpj.exe");
}

TEST(ForeignText, BytesThatAreNotUtf8AreEscaped) {
  EXPECT_EQ(printable("view \xff"), "view \\xff");
  EXPECT_EQ(printable("\xc0\xaf \xe2\x82 \xed\xa0\x80"), "\\xc0\\xaf \\xe2\\x82 \\xed\\xa0\\x80");
  EXPECT_EQ(printable("\xe2\x82"), "\\xe2\\x82");
}

TEST(ForeignText, TheMiddleOfALongTextIsLeftOut) {
  const std::string shown =
      printable("cannot read " + std::string(1 << 20, 'x') + "; copy it again");
  EXPECT_LE(shown.size(), kLongestMessage);
  EXPECT_THAT(shown, testing::StartsWith("cannot read xxx"));
  EXPECT_THAT(shown, HasSubstr(" bytes left out] "));
  EXPECT_THAT(shown, testing::EndsWith("; copy it again"));
  EXPECT_LE(shown_word(std::string(5000, '\x1b')).size(), kLongestWord);
}

TEST(ForeignText, WhatWasReturnedComesBackUnchanged) {
  std::string bytes;
  for (int i = 0; i < 100'000; ++i) bytes += char(i * i >> 3);
  for (std::size_t size : {10, 300, 1490, 1510, 3001, 100'000}) {
    const std::string once = printable(bytes.substr(0, size));
    EXPECT_EQ(printable(once), once) << size;
    EXPECT_LE(once.size(), kLongestMessage);
  }
}

TEST(ForeignText, ErrorsPassThroughIt) {
  EXPECT_STREQ(Error("no \x1b]0;title\x07 file").what(), "no \\x1b]0;title\\x07 file");
}

TEST(Wrapped, BreaksAtBlanksAndKeepsWhatIsCopiedWhole) {
  EXPECT_EQ(wrapped_at("one two three four", 9), "one two\nthree\nfour");
  EXPECT_EQ(wrapped_at("one two three", 9, 7), "one\ntwo three");
  EXPECT_EQ(wrapped_at("try `gemsplat view out/a` now", 12), "try\n`gemsplat view out/a`\nnow");
  EXPECT_EQ(wrapped_at("a lonely ` stays", 8), "a lonely\n` stays");
  EXPECT_EQ(wrapped_at("list:\n  one\n  two", 80), "list:\n  one\n  two");
  EXPECT_EQ(wrapped_at("äöü äöü", 7), "äöü äöü");
  EXPECT_EQ(wrapped_at("", 5), "");
}

}  // namespace
}  // namespace gs
