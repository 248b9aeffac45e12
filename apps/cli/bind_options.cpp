// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/bind_options.h"

#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <map>

#include "gs_app/jobs/parts/job.h"

namespace gs {
namespace {

/// Adds one option to the parser, by the type of its value.
struct Adder {
  CLI::App& app;
  const Option& option;
  std::vector<std::string>& flags;  // of the request

  std::string names() const { return fmt::format("{}", fmt::join(option.names, ",")); }

  CLI::Option* operator()(bool* value) const {
    return app.add_flag(names(), *value, option.meaning);
  }
  CLI::Option* operator()(std::optional<bool>* value) const {
    return app.add_flag(names(), *value, option.meaning);
  }
  template <class T>
  CLI::Option* operator()(T* value) const {
    return app.add_option(names(), *value, option.meaning);
  }
  CLI::Option* operator()(const OperationValue& value) const {
    if (value.is_switch) return app.add_flag(names(), option.meaning);
    return app.add_option(names(), option.meaning)
        ->expected(1)
        ->allow_extra_args(false)
        ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  }
  CLI::Option* operator()(const SettingValue& setting) const {
    const auto keep = [&flags = flags, key = setting.key](const std::string& value) {
      flags.push_back(key + "=" + value);
    };
    if (setting.is_switch)
      return app.add_flag_callback(
          names(), [keep, value = setting.value_of_switch] { keep(value); }, option.meaning);
    if (!setting.is_list)
      return app.add_option_function<std::string>(names(), keep, option.meaning)->take_last();
    const auto keep_list = [keep](const std::vector<std::string>& words) {
      keep(fmt::format("[{}]", fmt::join(words, ", ")));
    };
    return app.add_option_function<std::vector<std::string>>(names(), keep_list, option.meaning)
        ->delimiter(',');
  }
};

bool is_whole(const OptionValue& value) {
  return std::holds_alternative<int*>(value) || std::holds_alternative<long*>(value) ||
         std::holds_alternative<std::size_t*>(value) ||
         std::holds_alternative<std::optional<int>*>(value);
}

void add_checks(CLI::Option& parsed, const Option& option) {
  if (!option.choices.empty()) parsed.check(CLI::IsMember(option.choices));
  if (option.is_positive) parsed.check(CLI::PositiveNumber);
  if (option.is_not_negative) parsed.check(CLI::NonNegativeNumber);
  if (option.check) parsed.check(option.check);
  if (!option.limits) return;
  const auto [least, most] = *option.limits;
  if (is_whole(option.value))
    parsed.check(CLI::Range(static_cast<long>(least), static_cast<long>(most)));
  else
    parsed.check(CLI::Range(least, most));
}

void bind(CLI::App& app, const Option& option, std::vector<std::string>& flags) {
  CLI::Option& parsed = *std::visit(Adder{app, option, flags}, option.value);
  parsed.group(option.is_hidden ? "" : option.heading)->required(option.is_required);
  if (!option.is_flag()) parsed.type_name(option.shown_value());
  add_checks(parsed, option);
  if (option.words) parsed.expected(option.words->first, option.words->second);
  if (!option.if_bare.empty()) parsed.default_str(option.if_bare);
  if (option.has_commas) parsed.delimiter(',');
  if (option.is_repeated) parsed.expected(1)->take_all();
}

}  // namespace

void bind_options(CLI::App& app, const OptionList& list) {
  for (const Option& option : list.options) bind(app, option, list.settings.flags);
  for (const Option& option : list.options) {
    CLI::Option& parsed = *app.get_option(option.name());
    for (const std::string& other : option.excluded) parsed.excludes(app.get_option(other));
    for (const std::string& other : option.needed) parsed.needs(app.get_option(other));
  }
  for (const SubVerb& verb : list.sub_verbs) {
    CLI::App& sub = *app.add_subcommand(verb.name, verb.meaning);
    sub.fallthrough();
    sub.callback([is_given = verb.is_given] { *is_given = true; });
    bind_options(sub, verb.options);
  }
}

void take_parsed(const CLI::App& app, const OptionList& list) {
  std::map<std::string, const OperationValue*> operations;
  for (const Option& option : list.options) {
    if (app.get_option(option.name())->count() > 0) list.settings.given.push_back(option.name());
    if (const auto* operation = std::get_if<OperationValue>(&option.value))
      operations[option.name()] = operation;
  }
  std::map<std::string, std::size_t> used;
  for (const CLI::Option* parsed : app.parse_order()) {
    const auto found = operations.find(parsed->get_name());
    if (found == operations.end()) continue;
    const OperationValue& operation = *found->second;
    const std::size_t n = used[found->first]++;
    operation.operations->emplace_back(operation.name,
                                       operation.is_switch ? "" : parsed->results().at(n));
  }
}

std::vector<std::string> normalized_arguments(int argc, const char* const* argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  for (std::string& argument : arguments) {
    if (!argument.starts_with("--")) continue;
    const auto end =
        argument.begin() + std::ptrdiff_t(std::min(argument.find('='), argument.size()));
    std::replace(argument.begin(), end, '_', '-');
  }
  return arguments;
}

}  // namespace gs
