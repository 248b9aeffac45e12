// SPDX-License-Identifier: Apache-2.0
// Text of strangers (names of files, words in them) on its way to a terminal. Errors, warnings,
// `doctor` and `info` all pass through here, so no file can move the cursor, color the screen,
// forge a line of ours or fill it with a megabyte of one word.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace gs {

inline constexpr std::size_t kLongestMessage = 1500;  // bytes; two long paths and a sentence
inline constexpr std::size_t kLongestWord = 120;      // bytes of one name or value in a message

/// `text` with at most `most_bytes` bytes and nothing but printable UTF-8:
/// - control characters (also those of Latin-1), marks that turn the direction of writing, and
///   bytes that are not UTF-8 become \n, \r or \xNN;
/// - a tab stays, and a line end stays if two blanks follow it: blocks of ours are indented;
/// - the middle of a longer text is left out, because the remedy stands at the end.
/// What was returned once comes back unchanged. Needs `most_bytes` >= 100.
std::string fit_for_terminal(std::string_view text, std::size_t most_bytes);

/// Whether the bytes are UTF-8, which TOML and JSON files are: no stray, overlong or surrogate
/// sequence.
bool is_utf8(std::string_view text);

/// The text in lines of at most `columns` characters, broken at blanks; the first begins in column
/// `start`. Longer words stay whole, and so does what stands between two backticks: commands and
/// paths can be copied.
std::string wrapped_at(std::string_view text, std::size_t columns, std::size_t start = 0);

/// One name or value out of a file, for a message: no line ends, and at most kLongestWord bytes.
std::string shown_word(std::string_view word);

}  // namespace gs
