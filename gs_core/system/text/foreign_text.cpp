// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/text/foreign_text.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdint>

namespace gs {
namespace {

/// One character: its code point and its bytes; 0 bytes where no valid UTF-8 stands.
struct Character {
  std::uint32_t code = 0;
  std::size_t bytes = 0;
};

constexpr bool is_continuation(char c) { return (static_cast<unsigned char>(c) & 0xC0) == 0x80; }

Character character_at(std::string_view text, std::size_t at) {
  const auto first = static_cast<unsigned char>(text[at]);
  if (first < 0x80) return {first, 1};
  const std::size_t bytes = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || text.size() - at < bytes) return {};
  std::uint32_t code = first & (0x7Fu >> bytes);
  for (std::size_t i = 1; i < bytes; ++i) {
    if (!is_continuation(text[at + i])) return {};
    code = code << 6 | (static_cast<unsigned char>(text[at + i]) & 0x3Fu);
  }
  constexpr std::uint32_t kSmallest[] = {0, 0, 0x80, 0x800, 0x10000};
  const bool is_surrogate = code >= 0xD800 && code < 0xE000;
  if (code < kSmallest[bytes] || code > 0x10FFFF || is_surrogate) return {};
  return {code, bytes};
}

/// Whether a terminal draws the character, and does nothing else with it.
bool is_harmless(std::uint32_t code) {
  const bool is_control = code < 0x20 || (code >= 0x7F && code < 0xA0);
  const bool ends_line = code == 0x2028 || code == 0x2029;
  const bool turns_writing = code == 0x061C || code == 0x200E || code == 0x200F ||
                             (code >= 0x202A && code <= 0x202E) ||
                             (code >= 0x2066 && code <= 0x2069);
  return !is_control && !ends_line && !turns_writing;
}

void append_escaped(std::string& shown, std::string_view bytes) {
  for (const char c : bytes) {
    if (c == '\n') {
      shown += "\\n";
    } else if (c == '\r') {
      shown += "\\r";
    } else {
      shown += fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
    }
  }
}

std::string escaped(std::string_view text, bool keeps_blocks) {
  std::string shown;
  shown.reserve(text.size());
  for (std::size_t at = 0; at < text.size();) {
    const Character character = character_at(text, at);
    const std::string_view bytes = text.substr(at, character.bytes ? character.bytes : 1);
    const bool begins_block = bytes == "\n" && text.substr(at + 1, 2) == "  ";
    const bool stays = keeps_blocks && (bytes == "\t" || begins_block);
    if (stays || (character.bytes && is_harmless(character.code))) {
      shown += bytes;
    } else {
      append_escaped(shown, bytes);
    }
    at += bytes.size();
  }
  return shown;
}

/// Leaves the middle out, between whole characters. `text` is valid UTF-8, and lacks `missing` bytes
/// in its middle already.
std::string without_middle(const std::string& text, std::size_t missing, std::size_t most_bytes) {
  if (missing == 0 && text.size() <= most_bytes) return text;
  constexpr std::size_t kNoteBytes = 48;
  const std::size_t kept = most_bytes - kNoteBytes;
  std::size_t front = kept * 2 / 3, back = text.size() - (kept - front);
  while (front > 0 && is_continuation(text[front])) --front;
  while (front > 0 && text[front - 1] == '\n') --front;  // its block has been cut off
  while (back < text.size() && is_continuation(text[back])) ++back;
  return fmt::format("{} [{} bytes left out] {}", text.substr(0, front), missing + back - front,
                     text.substr(back));
}

std::string fit(std::string_view text, std::size_t most_bytes, bool keeps_blocks) {
  // What is left out need not be escaped first: a word may have a gigabyte.
  if (text.size() <= 2 * most_bytes)
    return without_middle(escaped(text, keeps_blocks), 0, most_bytes);
  const std::string_view front = text.substr(0, most_bytes),
                         back = text.substr(text.size() - most_bytes);
  return without_middle(escaped(front, keeps_blocks) + escaped(back, keeps_blocks),
                        text.size() - 2 * most_bytes, most_bytes);
}

/// Where a word ends that begins at `at`. A word with backticks holds what is between them.
std::size_t end_of_word(std::string_view text, std::size_t at) {
  for (; at < text.size() && text[at] != ' ' && text[at] != '\n'; ++at)
    if (text[at] == '`') {
      const std::size_t close = text.find('`', at + 1);
      if (close < text.find('\n', at)) at = close;
    }
  return std::min(at, text.size());
}

std::size_t columns_of(std::string_view text) {
  return std::size_t(
      std::count_if(text.begin(), text.end(), [](char c) { return !is_continuation(c); }));
}

}  // namespace

std::string wrapped_at(std::string_view text, std::size_t columns, std::size_t start) {
  std::string result;
  for (std::size_t at = 0, column = start; at < text.size();) {
    if (text[at] == '\n') {
      result += text[at++];
      column = 0;
      continue;
    }
    const std::size_t first = std::min(text.find_first_not_of(' ', at), text.size());
    const std::string_view blanks = text.substr(at, first - at),
                           word = text.substr(first, end_of_word(text, first) - first);
    const std::size_t width = columns_of(word);
    const bool breaks = column > 0 && !blanks.empty() && column + blanks.size() + width > columns;
    column = (breaks ? 0 : column + blanks.size()) + width;
    result += breaks ? "\n" : blanks;
    result += word;
    at = first + word.size();
  }
  return result;
}

std::string fit_for_terminal(std::string_view text, std::size_t most_bytes) {
  return fit(text, most_bytes, true);
}

std::string shown_word(std::string_view word) { return fit(word, kLongestWord, false); }

bool is_utf8(std::string_view text) {
  for (std::size_t at = 0; at < text.size();) {
    const Character character = character_at(text, at);
    if (character.bytes == 0) return false;
    at += character.bytes;
  }
  return true;
}

}  // namespace gs
