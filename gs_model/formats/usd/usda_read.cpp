// SPDX-License-Identifier: Apache-2.0
// Reads the text of a layer.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/parse_number.h"
#include "gs_model/formats/usd/usd_layer.h"

namespace gs {
namespace {

constexpr int kDeepestPrim = 100;

class UsdaParser {
 public:
  UsdaParser(const std::filesystem::path& path, std::string_view text) : path_(path), text_(text) {}

  UsdLayer layer() {
    if (!text_.starts_with("#usda")) fail("begins without #usda");
    UsdLayer layer;
    skip_blank();
    if (peek() == '(') stage_metadata(layer);
    for (skip_blank(); at_ < text_.size(); skip_blank()) {
      const std::size_t first = at_;
      const std::vector<std::string_view> words = words_of_line();
      if (is_prim(words))
        prim(words, layer.prims, 0);
      else
        skip_statement(first);
    }
    return layer;
  }

 private:
  char peek(std::size_t ahead = 0) const {
    return at_ + ahead < text_.size() ? text_[at_ + ahead] : '\0';
  }
  [[noreturn]] void fail(std::string_view what) const {
    const auto line = 1 + std::count(text_.begin(), text_.begin() + std::ptrdiff_t(at_), '\n');
    cannot_read(path_, fmt::format("line {} {}; export it again, or let usdcat of OpenUSD check it",
                                   line, what));
  }
  void expect(char wanted) {
    skip_blank();
    if (peek() != wanted) fail(fmt::format("lacks a {}", wanted));
    ++at_;
  }
  void skip_until(std::string_view end) {
    const std::size_t found = text_.find(end, at_);
    if (found == text_.npos) fail(fmt::format("lacks the closing {}", end));
    at_ = found + end.size();
  }
  void skip_blank(std::string_view blanks = " \t\r\n;") {
    for (; at_ < text_.size(); ++at_) {
      if (text_.substr(at_).starts_with("/*")) {
        skip_until("*/");
        --at_;  // the loop goes on behind it
        continue;
      }
      if (text_[at_] == '#' || text_.substr(at_).starts_with("//")) {
        at_ = std::min(text_.find('\n', at_), text_.size());
        if (blanks.find('\n') == blanks.npos || at_ == text_.size()) return;
      }
      if (blanks.find(text_[at_]) == blanks.npos) return;
    }
  }
  void skip_in_line() { skip_blank(" \t"); }

  std::string_view word(std::string_view others) {
    const std::size_t first = at_;
    while (std::isalnum(static_cast<unsigned char>(peek())) || (peek() & 0x80) ||
           (peek() && others.find(peek()) != others.npos))
      ++at_;
    return text_.substr(first, at_ - first);
  }
  /// Words before a string, a value, metadata or the end of the line.
  std::vector<std::string_view> words_of_line() {
    std::vector<std::string_view> words;
    for (;; skip_in_line()) {
      const std::string_view next = word("_:.[]");
      if (next.empty()) return words;
      words.push_back(next);
    }
  }
  bool is_quote() const { return peek() == '"' || peek() == '\''; }
  /// What stands between quotes, which may be single ones, or three.
  std::string_view string() {
    if (!is_quote()) fail("lacks a text in quotes");
    const std::string quotes(peek(1) == peek() && peek(2) == peek() ? 3 : 1, peek());
    const std::size_t first = at_ += quotes.size();
    for (; at_ < text_.size(); ++at_) {
      if (peek() == '\\') {
        ++at_;
      } else if (text_.substr(at_).starts_with(quotes)) {
        at_ += quotes.size();
        return text_.substr(first, at_ - quotes.size() - first);
      }
    }
    at_ = first;
    fail("has a text that does not end");
  }
  /// The next character, for an error.
  std::string next_shown() const {
    return at_ < text_.size() ? shown_word(text_.substr(at_, 1)) : "the end of the file";
  }

  void skip_token() {
    if (is_quote()) return void(string());
    if (peek() == '@') {
      const std::string_view end = text_.substr(at_).starts_with("@@@") ? "@@@" : "@";
      at_ += end.size();
      return skip_until(end);
    }
    if (peek() == '<') return skip_until(">");
    ++at_;
  }
  /// From a bracket to the one that closes it.
  void skip_brackets() {
    const std::size_t first = at_;
    int depth = 0;
    do {
      if (at_ >= text_.size()) {
        at_ = first;
        fail("has a bracket that is not closed");
      }
      const char c = peek();
      depth += c == '(' || c == '[' || c == '{' ? 1 : c == ')' || c == ']' || c == '}' ? -1 : 0;
      skip_token();
      if (depth > 0) skip_blank();
    } while (depth > 0);
  }
  void skip_value() {
    skip_blank();
    if (std::string_view("([{").find(peek()) != std::string_view::npos) return skip_brackets();
    if (std::string_view("\"'@<").find(peek()) == std::string_view::npos) {
      if (word("_:.+-").empty()) fail(fmt::format("has {} in place of a value", next_shown()));
      return;
    }
    skip_token();
    skip_in_line();
    if (peek() == '<') skip_token();  // a prim in a file
  }
  /// The rest of a statement that begins at `first` and whose words were taken, such as
  /// "reorder rootPrims = [...]", or variants.
  void skip_statement(std::size_t first) {
    skip_in_line();
    if (is_quote()) string();
    skip_in_line();
    if (peek() == '=') {
      ++at_;
      skip_value();
    } else if (peek() == '{' || peek() == '(') {
      skip_brackets();
    } else if (at_ == first) {
      fail(fmt::format("has {} where a prim or an attribute is expected", next_shown()));
    }
  }

  void stage_metadata(UsdLayer& layer) {
    for (++at_, skip_blank(); peek() != ')'; skip_blank()) {
      if (at_ >= text_.size()) fail("ends in the metadata of the stage");
      const std::size_t first = at_;
      const std::vector<std::string_view> words = words_of_line();
      if (words.size() == 1 && words[0] == "upAxis") {
        expect('=');
        skip_blank();
        layer.up_axis = string();
      } else {
        skip_statement(first);
      }
    }
    ++at_;
  }

  static bool is_prim(const std::vector<std::string_view>& words) {
    return !words.empty() && (words[0] == "def" || words[0] == "over" || words[0] == "class");
  }
  /// A prim behind its words; a class is abstract, and left out.
  void prim(const std::vector<std::string_view>& words, std::vector<UsdPrim>& siblings, int depth) {
    if (depth > kDeepestPrim) fail("has a prim in more than 100 others");
    UsdPrim prim{{}, std::string(words.size() > 1 ? words[1] : "")};
    skip_blank();
    prim.name = string();
    skip_blank();
    if (peek() == '(') skip_brackets();
    expect('{');
    for (skip_blank(); peek() != '}'; skip_blank()) {
      if (at_ >= text_.size()) fail(fmt::format("ends in the prim {}", shown_word(prim.name)));
      const std::size_t first = at_;
      const std::vector<std::string_view> inner = words_of_line();
      if (is_prim(inner))
        this->prim(inner, prim.children, depth + 1);
      else if (inner.size() < 2 || inner[0] == "variantSet" || inner[0] == "reorder")
        skip_statement(first);
      else
        attribute(inner, prim);
    }
    ++at_;
    if (words[0] != "class") siblings.push_back(std::move(prim));
  }

  void attribute(const std::vector<std::string_view>& words, UsdPrim& prim) {
    UsdAttribute attribute{std::string(words.back()), {std::string(words[words.size() - 2])}};
    skip_in_line();
    if (peek() == '=') {
      ++at_;
      skip_blank();
      value(attribute);
      prim.attributes.push_back(std::move(attribute));
      skip_in_line();
    }
    if (peek() == '(') skip_brackets();
  }
  void value(UsdAttribute& attribute) {
    UsdValue& value = attribute.value;
    const bool has_suffix = attribute.name.find('.') != attribute.name.npos;  // .timeSamples
    switch (has_suffix ? UsdNumbers::none : usd_numbers(value.type)) {
      case UsdNumbers::floats: return numbers(value.floats, parse_float);
      case UsdNumbers::doubles: return numbers(value.doubles, parse_number<double>);
      case UsdNumbers::words: return strings(value.words);
      case UsdNumbers::none: return skip_value();
    }
  }
  template <class T, class Parse>
  void numbers(std::vector<T>& numbers, Parse&& parse) {
    int depth = 0;
    do {
      skip_blank(" \t\r\n,");
      const char c = peek();
      if (c == '[' || c == '(') {
        ++depth, ++at_;
        continue;
      }
      if (c == ']' || c == ')') {
        --depth, ++at_;
        continue;
      }
      const std::string_view number = word("+-._");
      T value{};
      if (number == "true" || number == "false")
        value = T(number == "true");
      else if (number == "None")
        continue;
      else if (number.empty() || !parse(number, value))
        fail(fmt::format("has {} in place of a number",
                         number.empty() ? next_shown() : shown_word(number)));
      numbers.push_back(value);
    } while (depth > 0);
    if (depth < 0) fail("has a bracket too many");
  }
  void strings(std::vector<std::string>& words) {
    if (peek() != '[') {
      if (!is_quote()) return skip_value();  // None
      words.emplace_back(string());
      return;
    }
    for (++at_, skip_blank(" \t\r\n,"); peek() != ']'; skip_blank(" \t\r\n,"))
      words.emplace_back(string());
    ++at_;
  }

  const std::filesystem::path& path_;
  std::string_view text_;
  std::size_t at_ = 0;
};

}  // namespace

UsdNumbers usd_numbers(std::string_view type) {
  const auto begins = [&](auto... names) { return (type.starts_with(names) || ...); };
  if (begins("double", "matrix", "int", "uint", "bool", "timecode")) return UsdNumbers::doubles;
  if (begins("float", "half", "point3", "quat", "normal3", "vector3", "color", "texCoord"))
    return UsdNumbers::floats;
  return begins("token", "string") ? UsdNumbers::words : UsdNumbers::none;
}

std::size_t usd_width(std::string_view type) {
  if (type.starts_with("quat")) return 4;
  if (type.starts_with("matrix4")) return 16;
  const std::size_t digit = type.find_first_of("234");
  return digit == type.npos ? 1 : std::size_t(type[digit] - '0');
}

UsdLayer parse_usda(const std::filesystem::path& path, std::string_view text) {
  return UsdaParser(path, text).layer();
}

}  // namespace gs
