// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/parts/option_values.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/config/config_fields.h"

namespace gs {
namespace {

struct SettingKind {
  const char* name = "text";
  bool is_one_of_words = false;
};

SettingKind kind_of_setting(const std::string& key) {
  SettingKind kind;
  const Config config;
  visit_fields(config, [&](const auto& field) {
    using T = std::remove_cvref_t<decltype(field.value)>;
    if (field.key != key) return;
    if constexpr (std::is_floating_point_v<T>) kind.name = "float";
    if constexpr (std::is_integral_v<T> || std::is_same_v<T, std::vector<int>>) kind.name = "int";
    kind.is_one_of_words = std::is_enum_v<T>;
  });
  return kind;
}

std::string either_of(std::vector<std::string> words) {
  const std::string last = words.back();
  words.pop_back();
  return words.empty() ? last : fmt::format("{} or {}", fmt::join(words, ", "), last);
}

}  // namespace

std::string kind_of(const Option& option) {
  if (option.is_flag()) return "bool";
  if (const auto* setting = std::get_if<SettingValue>(&option.value))
    return kind_of_setting(setting->key).name;
  return std::visit(
      [](const auto& value) {
        using T = std::remove_cvref_t<decltype(value)>;
        constexpr bool is_whole = std::is_same_v<T, int*> || std::is_same_v<T, long*> ||
                                  std::is_same_v<T, std::size_t*> ||
                                  std::is_same_v<T, std::optional<int>*>;
        constexpr bool is_text = std::is_same_v<T, std::string*> ||
                                 std::is_same_v<T, std::vector<std::string>*> ||
                                 std::is_same_v<T, OperationValue>;
        return is_whole ? "int" : is_text ? "text" : "float";
      },
      option.value);
}

std::vector<std::string> choices_of(const Option& option) {
  const auto* const setting = std::get_if<SettingValue>(&option.value);
  const bool is_closed = setting && kind_of_setting(setting->key).is_one_of_words;
  return is_closed && !option.is_flag() ? option.suggested : option.choices;
}

bool takes_list(const Option& option) {
  const bool is_operation = std::holds_alternative<OperationValue>(option.value);
  return option.takes_several() || option.is_repeated || (is_operation && !option.is_flag());
}

bool allows(const Option& option, double number) {
  if (option.is_positive && !(number > 0)) return false;
  if (option.is_not_negative && !(number >= 0)) return false;
  return !option.limits || (number >= option.limits->first && number <= option.limits->second);
}

Json default_of(const Option& option) {
  return std::visit(
      [&](const auto& value) -> Json {
        using T = std::remove_cvref_t<decltype(value)>;
        if constexpr (std::is_same_v<T, bool*>) {
          return *value;
        } else if constexpr (std::is_same_v<T, SettingValue> || std::is_same_v<T, OperationValue>) {
          return nullptr;
        } else if constexpr (std::is_arithmetic_v<std::remove_pointer_t<T>>) {
          return allows(option, double(*value)) ? Json(*value) : Json();
        } else if constexpr (requires { value->has_value(); }) {
          return nullptr;
        } else {
          return value->empty() ? Json() : Json(*value);
        }
      },
      option.value);
}

std::string what_it_takes(const Option& option) {
  const std::string kind = kind_of(option);
  const std::vector<std::string> choices = choices_of(option);
  std::string text = !choices.empty()         ? either_of(choices)
                     : kind == "bool"         ? "true or false"
                     : kind == "int"          ? "a whole number"
                     : kind == "float"        ? "a number"
                     : option.takes_several() ? "words"
                                              : "text";
  if (option.limits)
    text += fmt::format(" from {} to {}", option.limits->first, option.limits->second);
  if (option.is_positive) text += " above 0";
  if (option.is_not_negative) text += " of at least 0";
  const bool is_setting = std::holds_alternative<SettingValue>(option.value);
  if (is_setting && (kind == "int" || kind == "float")) text += " or a word";
  return text;
}

}  // namespace gs
