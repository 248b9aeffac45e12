// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/parts/option.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>

#include "gs_core/config/config_fields.h"
#include "gs_core/error.h"

namespace gs {
namespace {

std::vector<std::string> parts_of(const std::string& text, const std::string& separator) {
  std::vector<std::string> parts;
  std::size_t begin = 0;
  for (std::size_t end; (end = text.find(separator, begin)) != text.npos;
       begin = end + separator.size())
    parts.push_back(text.substr(begin, end - begin));
  parts.push_back(text.substr(begin));
  return parts;
}

std::string in_capitals(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(),
                 [](unsigned char c) { return std::toupper(c); });
  return result;
}

// "cuda" can be typed as it is, "cuda:N" cannot.
bool is_typed(const std::string& word) {
  return std::none_of(word.begin(), word.end(),
                      [](unsigned char c) { return std::isupper(c) || c == ' '; });
}

// What --help says of a setting, and what it takes.
Option option_of_setting(const std::string& key) {
  Option option;
  SettingValue setting{key};
  std::string preset;
  const Config config;
  visit_fields(config, [&](const auto& field) {
    if (field.key != key) return;
    using T = std::remove_cvref_t<decltype(field.value)>;
    option.meaning = field.meaning;
    setting.is_switch = std::is_same_v<T, bool>;
    setting.is_list = std::is_same_v<T, std::vector<int>>;
    if constexpr (std::is_arithmetic_v<T>) preset = fmt::format("{}", field.value);
    if constexpr (std::is_same_v<T, std::string>) preset = field.value;
    if constexpr (std::is_enum_v<T>) preset = word_of(field.value);
    option.value_name = field.unit.empty() ? "N" : in_capitals(field.unit);
    if (field.limits.words.empty()) return;
    const std::vector<std::string> words = parts_of(std::string(field.limits.words), ", ");
    option.value_name = fmt::format("{}", fmt::join(words, "|"));
    std::copy_if(words.begin(), words.end(), std::back_inserter(option.suggested), is_typed);
  });
  GS_CHECK(!option.meaning.empty());
  if (!setting.is_switch && !preset.empty()) option.if_bare = preset;  // for the caller
  option.value = setting;
  return option;
}

}  // namespace

bool is_place(const std::string& name) { return !name.starts_with('-') && !name.starts_with('!'); }

std::string flag_of(const std::string& name) {
  return name.starts_with('!') ? name.substr(1) : name;
}

bool Option::is_flag() const {
  if (const auto* setting = std::get_if<SettingValue>(&value)) return setting->is_switch;
  if (const auto* operation = std::get_if<OperationValue>(&value)) return operation->is_switch;
  return std::holds_alternative<bool*>(value) ||
         std::holds_alternative<std::optional<bool>*>(value);
}

bool Option::is_positional() const { return std::any_of(names.begin(), names.end(), is_place); }

bool Option::takes_several() const {
  if (words) return words->second > 1;
  if (const auto* setting = std::get_if<SettingValue>(&value)) return setting->is_list;
  const bool is_vector = std::holds_alternative<std::vector<std::string>*>(value) ||
                         std::holds_alternative<std::vector<float>*>(value) ||
                         std::holds_alternative<std::vector<double>*>(value);
  return is_vector && !is_repeated;
}

std::string Option::name() const {
  const auto found = std::find_if(names.begin(), names.end(),
                                  [](const auto& name) { return name.starts_with("--"); });
  return found == names.end() ? names.front() : *found;
}

std::string Option::shown_value() const {
  if (is_flag()) return "";
  return value_name.empty() ? fmt::format("{}", fmt::join(choices, "|")) : value_name;
}

Option& OptionList::add(const std::string& names, OptionValue value, std::string meaning) {
  Option& option = options.emplace_back();
  option.names = parts_of(names, ",");
  option.meaning = std::move(meaning);
  option.value = value;
  return option;
}

Option& OptionList::setting(const std::string& names, const std::string& key,
                            const std::string& group, const std::string& meaning) {
  Option option = option_of_setting(key);
  option.names = parts_of(names, ",");
  if (!meaning.empty()) option.meaning = meaning;
  if (!option.if_bare.empty()) option.meaning += " [" + option.if_bare + "]";
  option.if_bare.clear();
  option.heading = group;
  return options.emplace_back(std::move(option));
}

Option& OptionList::operation(const std::string& name, const std::string& value_name,
                              Operations& operations, std::string meaning) {
  return add("--" + name, OperationValue{name, &operations, value_name.empty()}, std::move(meaning))
      .takes(value_name);
}

OptionList& OptionList::sub_verb(const std::string& name, const std::string& meaning,
                                 bool& is_given) {
  return sub_verbs.push_back({name, meaning, &is_given, OptionList(settings)}),
         sub_verbs.back().options;
}

Option& OptionList::get(const std::string& name) {
  const auto has_name = [&](const Option& option) {
    return std::find(option.names.begin(), option.names.end(), name) != option.names.end();
  };
  const auto found = std::find_if(options.begin(), options.end(), has_name);
  GS_CHECK(found != options.end());
  return *found;
}

}  // namespace gs
