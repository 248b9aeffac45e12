// SPDX-License-Identifier: Apache-2.0
// Printing a Config: a visitor over the list in config_fields.h.
#include "gs_core/config/text/config_text.h"

#include <algorithm>

#include "gs_core/config/config_fields.h"
#include "gs_core/error.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

constexpr std::size_t kCommentColumn = 32;

// The comment behind a field: "unit: meaning; one of words (source)".
template <class T>
std::string comment(const Field<T>& field) {
  std::string text;
  if (!field.unit.empty()) text += fmt::format("{}: ", field.unit);
  text += field.meaning;
  if (!field.limits.words.empty()) text += "; " + field.limits.text();
  if (!field.source.empty()) text += fmt::format(" ({})", field.source);
  return text;
}

template <class T>
void check_is_text(std::string_view, const T&) {}
void check_is_text(std::string_view key, const std::string& value) {
  if (is_utf8(value)) return;
  throw UsageError(fmt::format(
      "{} = {} is not UTF-8, so that no config.toml can name it; rename the file or folder", key,
      value));
}

}  // namespace

std::string toml_text(const std::string& value) {
  std::string text = "\"";
  for (const char c : value) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      text += {'\\', c};
    } else if (byte < 0x20 || byte == 0x7f) {
      text += fmt::format("\\u{:04x}", byte);
    } else {
      text += c;
    }
  }
  return text + '"';
}

std::string toml_text(const std::vector<int>& values) {
  return fmt::format("[{}]", fmt::join(values, ", "));
}

std::string to_toml(const Config& config) {
  std::string result = "# gemsplat: every setting of this run. Give the file back with -c.\n";
  std::string_view section;
  visit_fields(config, [&](const auto& field) {
    const std::size_t dot = field.key.find('.');
    if (field.key.substr(0, dot) != section) {
      section = field.key.substr(0, dot);
      result += fmt::format("\n[{}]\n", section);
    }
    check_is_text(field.key, field.value);
    const std::string setting =
        fmt::format("{} = {}", field.key.substr(dot + 1), toml_text(field.value));
    result += fmt::format("{:<{}}  # {}\n", setting, kCommentColumn, comment(field));
  });
  return result;
}

}  // namespace gs
