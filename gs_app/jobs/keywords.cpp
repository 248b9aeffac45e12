// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/keywords.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_app/jobs/parts/option_values.h"
#include "gs_app/jobs/verbs.h"
#include "gs_core/config/text/nearest_word.h"

namespace gs {
namespace {

/// Puts the value of one keyword where its option says.
class Taker {
 public:
  Taker(const Option& option, JobSettings& settings)
      : option_(option), settings_(settings), name_(keyword_of(option, settings)),
        kind_(kind_of(option)) {}

  void take(const Json& given) const {
    if (given.is_object()) return take_settings(given);
    const bool stands_alone = !option_.if_bare.empty() && given.is_boolean();
    const bool is_setting = std::holds_alternative<SettingValue>(option_.value);
    if ((stands_alone || (option_.is_flag() && !is_setting)) && given == false) return;
    if (given.is_array() && given.empty() && !is_setting) return;
    const Json value = stands_alone ? Json(option_.if_bare) : with_words(given);
    if (value.is_array() && !takes_list(option_)) refuse(value);
    std::visit([&](const auto& place) { put(place, value); }, option_.value);
    settings_.given.push_back(option_.name());
  }

 private:
  [[noreturn]] void refuse(const Json& value) const {
    throw UsageError(fmt::format("{} takes {}, and not {}: {}", name_, what_it_takes(option_),
                                 value.dump(), option_.meaning));
  }
  // Coordinates, "X,Y,Z", may be numbers, and so may what an operation takes.
  Json with_words(const Json& value) const {
    const bool is_operation = std::holds_alternative<OperationValue>(option_.value);
    if (is_operation && value.is_number()) return value.dump();
    const bool has_numbers =
        kind_ == "text" && value.is_array() &&
        std::ranges::all_of(value, [](const Json& v) { return v.is_number(); });
    if (!has_numbers || !(is_operation || option_.value_name.find(',') != std::string::npos))
      return value;
    const std::string text = value.dump();
    return text.substr(1, text.size() - 2);
  }
  void take_settings(const Json& object) const {
    const auto* const place = std::get_if<std::vector<std::string>*>(&option_.value);
    if (!place || *place != &settings_.settings) refuse(object);
    for (std::string& text : setting_texts_of(object))
      settings_.settings.push_back(std::move(text));
  }

  bool truth(const Json& value) const {
    if (!value.is_boolean()) refuse(value);
    return value.get<bool>();
  }
  double number(const Json& value) const {
    const bool is_number = kind_ == "int" ? value.is_number_integer() : value.is_number();
    if (!is_number || !allows(option_, value.get<double>())) refuse(value);
    check_choice(value, value.dump());
    return value.get<double>();
  }
  std::string word(const Json& value) const {
    if (!value.is_string()) refuse(value);
    check_choice(value, value.get<std::string>());
    return value.get<std::string>();
  }
  void check_choice(const Json& value, const std::string& word) const {
    const std::vector<std::string> choices = choices_of(option_);
    if (!choices.empty() && std::find(choices.begin(), choices.end(), word) == choices.end())
      refuse(value);
    const std::string wrong = option_.check ? option_.check(word) : "";
    if (!wrong.empty()) throw UsageError(name_ + ": " + wrong);
  }
  static Json listed(const Json& value) { return value.is_array() ? value : Json::array({value}); }

  void put(bool* place, const Json& value) const { *place = truth(value); }
  void put(std::optional<bool>* place, const Json& value) const { *place = truth(value); }
  void put(std::string* place, const Json& value) const { *place = word(value); }
  void put(std::vector<std::string>* place, const Json& value) const {
    place->clear();
    for (const Json& one : listed(value)) place->push_back(word(one));
    check_count(value, place->size());
  }
  template <class T>
  void put(std::vector<T>* place, const Json& value) const {
    place->clear();
    for (const Json& one : listed(value)) place->push_back(T(number(one)));
    check_count(value, place->size());
  }
  template <class T>
  void put(std::optional<T>* place, const Json& value) const {
    *place = T(number(value));
  }
  template <class T>
  void put(T* place, const Json& value) const {
    if (value != Json(*place)) *place = T(number(value));  // the default may be none to give
  }
  void put(const OperationValue& place, const Json& value) const {
    if (place.is_switch && truth(value)) place.operations->emplace_back(place.name, "");
    if (!place.is_switch)
      for (const Json& one : listed(value)) place.operations->emplace_back(place.name, word(one));
  }
  void put(const SettingValue& place, const Json& value) const {
    if (place.is_switch && place.value_of_switch != "true") {
      if (truth(value)) keep(place, place.value_of_switch);
    } else if (place.is_switch) {
      keep(place, truth(value) ? "true" : "false");
    } else if (value.is_string()) {
      const std::string text = word(value);
      keep(place, text.starts_with('+') ? text : value.dump());  // "+500": more iterations
    } else if (value.is_boolean() || (value.is_number() && kind_ == "text")) {
      refuse(value);
    } else {
      keep(place, value.dump());
    }
  }
  void keep(const SettingValue& place, const std::string& value) const {
    settings_.flags.push_back(place.key + "=" + value);
  }
  void check_count(const Json& value, std::size_t count) const {
    if (option_.words && (int(count) < option_.words->first || int(count) > option_.words->second))
      throw UsageError(fmt::format("{} takes {} values, and not {}: {}", name_,
                                   option_.words->second, value.dump(), option_.meaning));
  }

  const Option& option_;
  JobSettings& settings_;
  std::string name_, kind_;
};

std::string in_snake_case(std::string name) {
  name.erase(0, name.find_first_not_of("!-"));
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

using KeywordOptions = std::vector<const Option*>;

KeywordOptions options_of(const OptionList& list, const std::string& sub_verb) {
  KeywordOptions result;
  const auto add = [&](const OptionList& some) {
    for (const Option& option : some.options)
      if (!keyword_of(option, list.settings).empty()) result.push_back(&option);
  };
  for (const SubVerb& sub : list.sub_verbs)
    if (sub.name == sub_verb) add(sub.options);
  add(list);
  return result;
}

const Option& option_named(const KeywordOptions& options, const std::string& keyword,
                           const JobSettings& settings) {
  std::vector<std::string> known;
  for (const Option* option : options) {
    known.push_back(keyword_of(*option, settings));
    if (known.back() == keyword) return *option;
  }
  const std::string nearest = nearest_word(keyword, known);
  throw UsageError("there is no keyword " + keyword +
                   (nearest.empty() ? "" : "; did you mean " + nearest + "?"));
}

void check_together(const KeywordOptions& options, const JobSettings& settings) {
  const auto keyword_named = [&](const std::string& name) {
    for (const Option* option : options)
      if (option->name() == name) return keyword_of(*option, settings);
    return name;
  };
  for (const Option* option : options) {
    const std::string keyword = keyword_of(*option, settings);
    const bool is_given = settings.was_given(option->name());
    for (const std::string& other : option->excluded)
      if (is_given && settings.was_given(other))
        throw UsageError(keyword + " and " + keyword_named(other) + " exclude each other");
    for (const std::string& other : option->needed)
      if (is_given && !settings.was_given(other))
        throw UsageError(keyword + " goes with " + keyword_named(other));
  }
}

}  // namespace

std::string keyword_of(const Option& option, const JobSettings& settings) {
  const auto* const flag = std::get_if<bool*>(&option.value);
  const bool is_said_elsewhere = flag && (*flag == &settings.quiet || *flag == &settings.verbose);
  if (option.is_hidden || is_said_elsewhere) return {};
  for (const std::string& name : option.names)
    if (is_place(name)) return in_snake_case(name);
  for (const std::string& name : option.names)
    if (name.starts_with("--") && name != "--from") return in_snake_case(name);  // a word of Python
  return in_snake_case(option.name());
}

Json describe_keywords(OptionList& list, const std::string& sub_verb) {
  Json rows = Json::array();
  for (const Option* option : options_of(list, sub_verb)) {
    Json choices = Json::array();
    for (const std::string& word : choices_of(*option))
      choices.push_back(kind_of(*option) == "int" ? Json(std::stoi(word)) : Json(word));
    rows.push_back({{"name", keyword_of(*option, list.settings)},
                    {"kind", kind_of(*option)},
                    {"several", takes_list(*option)},
                    {"choices", choices},
                    {"setting", std::holds_alternative<SettingValue>(option->value)},
                    {"stands_alone", !option->if_bare.empty()},
                    {"default", default_of(*option)},
                    {"place", option->is_positional()},
                    {"required", option->is_required},
                    {"meaning", option->meaning}});
  }
  return rows;
}

void take_keywords(OptionList& list, const Json& values, const std::string& sub_verb) {
  for (SubVerb& sub : list.sub_verbs) *sub.is_given = sub.name == sub_verb;
  const KeywordOptions options = options_of(list, sub_verb);
  for (const auto& [keyword, value] : values.items()) {
    const Option& option = option_named(options, keyword, list.settings);
    if (!value.is_null()) Taker(option, list.settings).take(value);
  }
  check_together(options, list.settings);
}

void check_whole(const OptionList& list, const std::string& sub_verb) {
  for (const Option* option : options_of(list, sub_verb))
    if (option->is_required && !list.settings.was_given(option->name()))
      throw UsageError(keyword_of(*option, list.settings) + " is missing: " + option->meaning);
}

std::vector<std::string> setting_texts_of(const Json& object, const std::string& section) {
  std::vector<std::string> texts;
  for (const auto& [name, value] : object.items()) {
    const std::string key = section + name;
    if (value.is_null()) throw UsageError("the setting " + key + " cannot be null");
    if (value.is_object())
      for (std::string& text : setting_texts_of(value, key + ".")) texts.push_back(std::move(text));
    else
      texts.push_back(key + "=" + value.dump());
  }
  return texts;
}

void apply_settings(Config& config, const Json& settings) {
  if (settings.is_string())
    load_config(config, settings.get<std::string>());
  else if (settings.is_object())
    for (const std::string& text : setting_texts_of(settings)) apply_setting(config, text);
  else if (settings.is_array())
    for (const Json& one : settings) apply_settings(config, one);
  else if (!settings.is_null())
    throw UsageError("config must be an object of settings, a name, or a list of these");
}

std::unique_ptr<VerbCall> call_of(const std::string& verb) {
  for (const Verb& one : verbs())
    if (one.name == verb) return one.call();
  throw UsageError("there is no verb " + verb);
}

FilledVerb::FilledVerb(const std::string& verb, const Json& values) : call_(call_of(verb)) {
  take_keywords(call_->options(), values);
}

void FilledVerb::apply_to(Config& config) const {
  for (const std::string& flag : settings().flags) apply_setting(config, flag);
}

std::string FilledVerb::device() const {
  Config config;
  apply_to(config);
  return config.train.device;
}

}  // namespace gs
