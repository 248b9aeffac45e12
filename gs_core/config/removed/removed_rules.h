// SPDX-License-Identifier: Apache-2.0
// Settings of [density] that older versions had and that are constants of a method now
// (gs_core/density). An older config is read as the method that has the same constants.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "gs_core/config/text/read_toml.h"

namespace gs {

/// The settings of one config, or of one assignment, that are constants now.
class RemovedRules {
 public:
  /// True if the key was such a setting; its value is kept. `where`: "file:line: " or empty.
  bool take(std::string_view key, const toml::node& node, std::string_view where);

  /// The strategy whose constants are those of `strategy` with the kept ones in place of some. A
  /// config that names an older strategy (`named`; empty: it names none) has settings that did not
  /// count under it. Throws a UsageError that names a setting if no strategy is like that.
  std::string resolved(const std::string& strategy, std::string_view named) const;

 private:
  struct Setting {
    std::string_view rule;         // the key without its section
    std::optional<double> number;  // a truth value is 0 or 1
    std::optional<std::string> word;
    std::string text, where;
  };
  std::vector<Setting> settings_;
};

}  // namespace gs
