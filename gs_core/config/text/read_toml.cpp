// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/text/read_toml.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdint>
#include <sstream>

#include "gs_core/config/text/config_text.h"
#include "gs_core/error.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

constexpr std::uint64_t kLargestToml = std::uint64_t(1) << 20;  // bytes; a run's config has 20,000

/// Walks through a text without parsing it and stops where the parser must not go. Like the parser,
/// it takes a string of one line to end with its line.
class TomlWalk {
 public:
  explicit TomlWalk(std::string_view text) : text_(text) {
    if (text_.starts_with("\xEF\xBB\xBF")) at_ = begin_ = 3;  // a mark of UTF-8
    while (at_ < text_.size() && !is_too_deep() && !has_bad_name_ && !fault_) step();
  }
  int line() const { return line_; }  // where it has stopped
  /// Tables, lists and parts of a key nest deeper than kDeepestToml.
  bool is_too_deep() const { return int(brackets_.size()) + dots_ > kDeepestToml; }
  /// A table's name, as in [name], begins with a character that no key has. toml++ 3.3 takes it for
  /// granted that there is none, and checks that by assert().
  bool has_bad_name() const { return has_bad_name_; }
  /// What else toml++ takes for granted, or calls unreachable; null if there is nothing.
  const char* fault() const { return fault_; }

 private:
  void step() {
    switch (const char c = text_[at_]) {
      case '#': at_ = std::min(text_.find('\n', at_), text_.size()); return;
      case '"':
      case '\'':
        if (!may_begin_value())
          fault_ = "a string follows a number or a word without quotes";
        else
          skip_string(c);
        return;
      case '.': ++dots_; break;
      case '[':
      case '{':
        if (!may_begin_value())
          fault_ = "a list or table follows a number or a word without quotes";
        if (c == '[')
          has_bad_name_ = brackets_.empty() && !is_value_ && !is_name(text_.substr(at_ + 1));
        else
          is_value_ = false;  // but a key
        brackets_ += c, dots_ = 0;
        break;
      case ']':
      case '}':
        if (c == '}' && brackets_.ends_with('[')) fault_ = "a } closes a list, which ends with ]";
        if (c == '}') is_value_ = true;
        if (!brackets_.empty()) brackets_.pop_back();
        dots_ = 0;
        break;
      case '\n':
        ++line_, dots_ = 0;
        if (brackets_.empty()) is_value_ = false;
        break;
      case '=':
        if (is_value_)
          fault_ = brackets_.ends_with('[') ? "a = stands inside of a list, which ends with ]"
                                            : "a value has a = and no quotes";
        is_value_ = true, dots_ = 0;
        break;
      case ',':
        dots_ = 0;
        if (brackets_.ends_with('{')) is_value_ = false;
        break;
      // Only times have it, which no config needs; toml++ relies on digits in them.
      case ':': fault_ = "a key or value has a : and no quotes"; break;
      default:  // part of a key or value
        if (static_cast<unsigned char>(c) >= 0x80)
          fault_ = "a key or value has letters beyond ASCII and no quotes";
        break;
    }
    ++at_;
  }
  /// Whether the parser may look for a key in what follows the first [ of a table: "name]",
  /// "[name]]". It has errors of its own for a ] and for the end of the text.
  static bool is_name(std::string_view rest) {
    constexpr std::string_view kBlanks = " \t";
    if (rest.starts_with('[')) rest.remove_prefix(1);
    const std::size_t first = rest.find_first_not_of(kBlanks);
    if (first == rest.npos) return true;
    const char c = rest[first];
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           std::string_view("_-\"']").find(c) != std::string_view::npos;
  }
  /// Whether a string, list or table may begin here. None may behind a number, as in 1"a", 1."a" or
  /// 1["a"], where toml++ reads on. Keys have dots before strings, as in a."b".
  bool may_begin_value() const {
    const std::size_t last = text_.substr(begin_, at_ - begin_).find_last_not_of(" \t");
    if (last == text_.npos) return true;
    const char before = text_[begin_ + last];
    return before == '.' ? !is_value_
                         : std::string_view("\r\n=,[]{}\"'").find(before) != std::string_view::npos;
  }
  void skip_string(char quote) {
    const bool has_lines = text_.substr(at_, 3) == std::string(3, quote);
    const std::string end(has_lines ? 3 : 1, quote);
    for (at_ += end.size(); at_ < text_.size(); ++at_) {
      if (text_[at_] == '\n') {
        if (!has_lines) return;
        ++line_;
      } else if (text_[at_] == '\\' && quote == '"') {
        ++at_;
        if (has_lines && begins_beyond_ascii(text_.substr(at_))) {
          fault_ = "a \\ in a string of several lines is followed by a letter beyond ASCII";
          return;
        }
        if (at_ < text_.size() && text_[at_] == '\n') ++line_;
      } else if (text_.substr(at_, end.size()) == end) {
        at_ += end.size();
        // One or two further quotes belong to a string of several lines, as in """a"""".
        for (int i = 0; has_lines && i < 2 && text_.substr(at_).starts_with(quote); ++i) ++at_;
        return;
      }
    }
  }
  /// Whether the first letter behind blanks and ends of lines is beyond ASCII.
  static bool begins_beyond_ascii(std::string_view rest) {
    const std::size_t first = rest.find_first_not_of(" \t\r\n");
    return first != rest.npos && static_cast<unsigned char>(rest[first]) >= 0x80;
  }

  std::string_view text_;
  std::size_t at_ = 0, begin_ = 0;  // begin_: behind a mark of UTF-8
  int line_ = 1, dots_ = 0;
  std::string brackets_;   // that are open
  bool is_value_ = false;  // behind the = of a key
  bool has_bad_name_ = false;
  const char* fault_ = nullptr;
};

}  // namespace

std::string read_toml_text(const std::filesystem::path& file) {
  return read_text_file(file, kLargestToml);
}

toml::table parse_toml(std::string_view text, const std::string& shown) {
  const TomlWalk walk(text);
  if (walk.is_too_deep())
    throw UsageError(
        fmt::format("{}:{}: tables, lists and parts of a key nest deeper than {} levels; a config "
                    "needs three, so check what the file is",
                    shown, walk.line(), kDeepestToml));
  if (walk.has_bad_name())
    throw UsageError(
        fmt::format("{}:{}: the name of a table begins with a letter, a digit, _, - or "
                    "a quote, as in [train]; correct the line",
                    shown, walk.line()));
  if (const char* const fault = walk.fault())
    throw UsageError(fmt::format("{}:{}: {}; correct the line", shown, walk.line(), fault));
  try {
    return toml::parse(text, shown);
  } catch (const toml::parse_error& error) {
    throw UsageError(fmt::format("{}:{}: {}; the file must be TOML", shown,
                                 error.source().begin.line, shown_word(error.description())));
  }
}

std::string text_of(const toml::node& node) {
  std::string text;
  const auto add = [&](const std::string& item) { text += (text.empty() ? "" : ", ") + item; };
  if (const toml::array* items = node.as_array()) {
    for (const toml::node& item : *items) add(text_of(item));
    return "[" + text + "]";
  }
  if (const toml::table* entries = node.as_table()) {
    for (const auto& [key, value] : *entries)
      add(toml_text(std::string(key.str())) + " = " + text_of(value));
    return "{" + text + "}";
  }
  if (const auto string = node.value_exact<std::string>()) return toml_text(*string);
  if (const auto number = node.value_exact<double>()) return toml_text(*number);
  if (const auto number = node.value_exact<std::int64_t>()) return toml_text(*number);
  if (const auto truth = node.value_exact<bool>()) return toml_text(*truth);
  std::ostringstream date_or_time;
  node.visit([&](const auto& value) { date_or_time << value; });
  return date_or_time.str();
}

}  // namespace gs
