// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/read_toml.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdint>

#include "gs_core/error.h"
#include "gs_core/foreign_text.h"
#include "gs_core/text_file.h"

namespace gs {
namespace {

constexpr std::uint64_t kLargestToml = std::uint64_t(1) << 20;  // bytes; a run's config has 20,000

/// Walks through a text without parsing it and stops where it nests too deep. Like the parser, it
/// takes a string of one line to end with its line.
class DepthOfToml {
 public:
  explicit DepthOfToml(std::string_view text) : text_(text) {
    while (at_ < text_.size() && depth() <= kDeepestToml) step();
  }
  /// The line that nests too deep; 0 if there is none.
  int line_too_deep() const { return depth() > kDeepestToml ? line_ : 0; }

 private:
  int depth() const { return brackets_ + dots_; }
  void step() {
    switch (const char c = text_[at_]) {
      case '#': at_ = std::min(text_.find('\n', at_), text_.size()); return;
      case '"':
      case '\'': skip_string(c); return;
      case '.': ++dots_; break;
      case '[':
      case '{': ++brackets_, dots_ = 0; break;
      case ']':
      case '}': brackets_ = std::max(0, brackets_ - 1), dots_ = 0; break;
      case '\n': ++line_, dots_ = 0; break;
      case '=':
      case ',': dots_ = 0; break;
      default: break;  // part of a key or value
    }
    ++at_;
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
        if (at_ < text_.size() && text_[at_] == '\n') ++line_;
      } else if (text_.substr(at_, end.size()) == end) {
        at_ += end.size();
        return;
      }
    }
  }

  std::string_view text_;
  std::size_t at_ = 0;
  int line_ = 1, brackets_ = 0, dots_ = 0;
};

}  // namespace

std::string read_toml_text(const std::filesystem::path& file) {
  return read_text_file(file, kLargestToml);
}

toml::table parse_toml(std::string_view text, const std::string& shown) {
  if (const int line = DepthOfToml(text).line_too_deep())
    throw UsageError(
        fmt::format("{}:{}: tables, lists and parts of a key nest deeper than {} levels; a config "
                    "needs three, so check what the file is",
                    shown, line, kDeepestToml));
  try {
    return toml::parse(text, shown);
  } catch (const toml::parse_error& error) {
    throw UsageError(fmt::format("{}:{}: {}; the file must be TOML", shown,
                                 error.source().begin.line, shown_word(error.description())));
  }
}

}  // namespace gs
