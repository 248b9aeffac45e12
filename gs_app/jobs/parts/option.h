// SPDX-License-Identifier: Apache-2.0
// One option of a verb as data: its names, what it means, what it takes, and where its value goes.
// A verb has one list of them. Flags, help, man pages, completions, the page of commands and the
// keyword arguments of Python come from that list.
#pragma once

#include <deque>
#include <functional>
#include <list>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace gs {

struct JobSettings;
struct SubVerb;

/// Operations in the order in which they are given: {"keep", "opacity=0.1.."}. A flag has no value.
using Operations = std::vector<std::pair<std::string, std::string>>;

/// The value is a setting of the config, such as "train.seed". A switch takes no value and gives
/// it this one.
struct SettingValue {
  std::string key;
  bool is_switch = false, is_list = false;
  std::string value_of_switch = "true";
};

/// Each use of the option is one more operation of the list.
struct OperationValue {
  std::string name;
  Operations* operations;
  bool is_switch;
};

/// Where the value goes. A pointer to bool is a flag that takes no value.
using OptionValue = std::variant<bool*, std::optional<bool>*, int*, long*, std::size_t*, float*,
                                 double*, std::string*, std::optional<int>*, std::optional<double>*,
                                 std::vector<std::string>*, std::vector<float>*,
                                 std::vector<double>*, SettingValue, OperationValue>;

/// Says what is wrong with a word; empty if nothing is.
using WordCheck = std::function<std::string(const std::string&)>;

/// Chained calls describe it: list("--views", views, "number of views [8]").between(1, 1000).
struct Option {
  std::vector<std::string> names;  // "-o", "--output"; "!--no-open" says no; a positional: "model"
  std::string meaning;             // what --help says
  OptionValue value;
  std::string value_name;              // "FILE"
  std::string heading = "Options";     // in --help
  std::vector<std::string> choices;    // all words that the value can be; empty: others, too
  std::vector<std::string> suggested;  // some of them
  std::optional<std::pair<double, double>> limits;  // least and most
  WordCheck check;
  std::string if_bare;                       // the value where the option stands alone
  std::optional<std::pair<int, int>> words;  // how many it takes at once; a vector: any number
  bool is_positive = false, is_not_negative = false;
  bool is_required = false, is_rare = false, is_hidden = false;
  bool has_commas = false;                    // between words
  bool is_repeated = false;                   // each use adds one word
  std::vector<std::string> excluded, needed;  // names of others

  Option& takes(std::string name) { return value_name = std::move(name), *this; }
  Option& group(std::string name) { return heading = std::move(name), *this; }
  Option& one_of(std::vector<std::string> all) { return choices = std::move(all), *this; }
  Option& suggests(std::vector<std::string> some) { return suggested = std::move(some), *this; }
  Option& between(double least, double most) { return limits.emplace(least, most), *this; }
  Option& positive() { return is_positive = true, *this; }
  Option& not_negative() { return is_not_negative = true, *this; }
  Option& required() { return is_required = true, *this; }
  /// Only --help-all shows it.
  Option& rare() { return is_rare = true, *this; }
  /// Nothing shows it: a name that other programs use.
  Option& hidden() { return is_hidden = true, *this; }
  Option& commas() { return has_commas = true, *this; }
  Option& repeated() { return is_repeated = true, *this; }
  Option& count(int least, int most) { return words.emplace(least, most), *this; }
  Option& alone(std::string word) { return if_bare = std::move(word), count(0, 1); }
  Option& checked(WordCheck how) { return check = std::move(how), *this; }
  Option& excludes(std::string name) { return excluded.push_back(std::move(name)), *this; }
  Option& needs(std::string name) { return needed.push_back(std::move(name)), *this; }

  bool is_flag() const;        // takes no value
  bool is_positional() const;  // has a place, and maybe flags, too
  bool takes_several() const;  // words at once
  /// Its first long name, "--output"; of an option without one, "model".
  std::string name() const;
  /// "FILE", or "png|exr" for choices.
  std::string shown_value() const;
};

/// Whether the name is that of a place on the command line, "model", and not of a flag.
bool is_place(const std::string& name);
/// "--no-open" of "!--no-open".
std::string flag_of(const std::string& name);

/// The options of a verb, in the order of --help.
class OptionList {
 public:
  explicit OptionList(JobSettings& settings) : settings(settings) {}

  template <class T>
  Option& operator()(const std::string& names, T& value, std::string meaning) {
    return add(names, &value, std::move(meaning));
  }
  /// An option for the setting `key`, with the setting's own meaning where no other is given.
  Option& setting(const std::string& names, const std::string& key, const std::string& group,
                  const std::string& meaning = {});
  /// An option whose uses are operations; without a name for its value it is a flag.
  Option& operation(const std::string& name, const std::string& value_name, Operations& operations,
                    std::string meaning);
  /// A word such as `diff` of `config diff`, whose own options follow; `is_given` says whether it
  /// was there.
  OptionList& sub_verb(const std::string& name, const std::string& meaning, bool& is_given);

  /// The option of this name. It is an internal error if there is none.
  Option& get(const std::string& name);

  JobSettings& settings;
  std::string json_meaning = "print JSON";  // what --json does
  std::deque<Option> options;
  std::list<SubVerb> sub_verbs;
  /// Rows of a table at the end of --help.
  std::string footer_title;
  std::vector<std::pair<std::string, std::string>> footer;

 private:
  Option& add(const std::string& names, OptionValue value, std::string meaning);
};

struct SubVerb {
  std::string name, meaning;
  bool* is_given;
  OptionList options;
};

}  // namespace gs
