// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/removed/removed_rules.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "gs_core/config/text/config_text.h"
#include "gs_core/density/growth_method.h"
#include "gs_core/error.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {

template <>
struct Words<GrowthCurve> {
  static constexpr Word<GrowthCurve> kTable[] = {{"none", GrowthCurve::none},
                                                 {"linear", GrowthCurve::linear},
                                                 {"root", GrowthCurve::root},
                                                 {"parabola", GrowthCurve::parabola},
                                                 {"ramp", GrowthCurve::ramp}};
};
template <>
struct Words<StatisticsWindow> {
  static constexpr Word<StatisticsWindow> kTable[] = {{"refinement", StatisticsWindow::refinement},
                                                      {"epoch", StatisticsWindow::epoch}};
};
template <>
struct Words<GrowthSelection> {
  static constexpr Word<GrowthSelection> kTable[] = {{"top_k", GrowthSelection::top_k},
                                                     {"race", GrowthSelection::race}};
};
template <>
struct Words<SplitPlacement> {
  static constexpr Word<SplitPlacement> kTable[] = {{"draw", SplitPlacement::draw},
                                                    {"axis", SplitPlacement::axis}};
};
template <>
struct Words<OpacityPolicy> {
  static constexpr Word<OpacityPolicy> kTable[] = {{"none", OpacityPolicy::none},
                                                   {"reset", OpacityPolicy::reset},
                                                   {"halve", OpacityPolicy::halve}};
};
template <>
struct Words<MomentClearing> {
  static constexpr Word<MomentClearing> kTable[] = {{"none", MomentClearing::none},
                                                    {"opacity", MomentClearing::opacity},
                                                    {"all", MomentClearing::all}};
};

namespace {

constexpr std::string_view kSection = "density.";
constexpr float kFormerMostGrowth = 0.3f;  // of growth, until November 2026

// Calls visit(name of the former setting, value) for each constant of a method that was one.
template <class Visitor>
void visit_rules(GrowthMethod& method, Visitor&& visit) {
  visit("score", method.score);
  visit("score_threshold", method.score_threshold);
  visit("mask_error", method.mask_error);
  visit("absolute_gradient", method.absolute_gradient);
  visit("window", method.window);
  visit("every_epochs", method.every_epochs);
  visit("select", method.select);
  visit("curve", method.curve);
  visit("ramp_from", method.ramp_from);
  visit("most_growth", method.most_growth);
  visit("small_scale", method.small_scale);
  visit("split", method.split.place);
  visit("split_offset", method.split.offset);
  visit("split_along", method.split.along);
  visit("split_across", method.split.across);
  visit("keep_parent", method.split.keeps_parent);
  visit("child_opacity_factor", method.split.opacity_factor);
  visit("opacity_policy", method.opacity.policy);
  visit("opacity_amount", method.opacity.amount);
  visit("opacity_clears", method.opacity.clears);
  visit("opacity_cap", method.opacity_cap);
  visit("prune_unseen", method.prune_unseen);
  visit("recovery_prune", method.recovery_prune);
  visit("recovery_after", method.recovery_after);
  visit("recovery_until", method.recovery_until);
  visit("soft_prune", method.soft_prune);
  visit("hard_prune", method.hard_prune);
  visit("share_prune_from", method.share_prune_from);
  visit("share_prune_every", method.share_prune_every);
  visit("share_prune_until", method.share_prune_until);
  visit("late_prune_opacity", method.late_prune_opacity);
}

// All of the other settings had no effect under these two.
constexpr std::array<std::string_view, 4> kOfAdaptive = {"absolute_gradient", "window",
                                                         "every_epochs", "small_scale"};
constexpr std::array<std::string_view, 1> kOfMcmc = {"every_epochs"};

bool counted(std::string_view rule, std::string_view named) {
  const auto is_among = [&](const auto& rules) {
    return std::find(rules.begin(), rules.end(), rule) != rules.end();
  };
  if (named == "adaptive") return is_among(kOfAdaptive);
  return named != "mcmc" || is_among(kOfMcmc);
}

// The rules with those that have no effect set to what a method without them has.
GrowthMethod effective(GrowthMethod method) {
  const GrowthMethod none;
  if (method.score != GrowthScore::mask) method.mask_error = none.mask_error;
  if (method.curve != GrowthCurve::ramp) method.ramp_from = none.ramp_from;
  if (method.split.place != SplitPlacement::axis) {
    method.split.offset = none.split.offset;
    method.split.along = none.split.along;
    method.split.across = none.split.across;
  }
  if (method.recovery_prune == 0) {
    method.recovery_after = none.recovery_after;
    method.recovery_until = none.recovery_until;
  }
  if (!method.prunes_shares()) {
    method.share_prune_from = none.share_prune_from;
    method.share_prune_every = none.share_prune_every;
    method.share_prune_until = none.share_prune_until;
  }
  return method;
}

using RuleTexts = std::vector<std::pair<std::string_view, std::string>>;
RuleTexts texts_of(const GrowthMethod& method) {
  RuleTexts texts;
  GrowthMethod rules = effective(method);
  visit_rules(rules, [&](std::string_view name, const auto& value) {
    texts.emplace_back(name, toml_text(value));
  });
  return texts;
}

// The rules, by name, in which two methods differ.
std::vector<std::string_view> differences(const RuleTexts& a, const RuleTexts& b) {
  std::vector<std::string_view> names;
  for (std::size_t i = 0; i < a.size(); ++i)
    if (a[i].second != b[i].second) names.push_back(a[i].first);
  return names;
}

}  // namespace

bool RemovedRules::take(std::string_view key, const toml::node& node, std::string_view where) {
  if (!key.starts_with(kSection)) return false;
  bool is_rule = false;
  GrowthMethod any;
  visit_rules(any, [&](std::string_view name, const auto&) {
    if (key.substr(kSection.size()) != name) return;
    is_rule = true;
    Setting setting{name, {}, node.value_exact<std::string>(), text_of(node), std::string(where)};
    if (node.is_number()) setting.number = node.value<double>();
    if (node.is_boolean()) setting.number = *node.value<bool>() ? 1.0 : 0.0;
    settings_.push_back(std::move(setting));
  });
  return is_rule;
}

std::string RemovedRules::resolved(const std::string& strategy, std::string_view named) const {
  if (settings_.empty()) return strategy;
  const auto refusal = [](const Setting& setting, std::string_view nearest) {
    return UsageError(fmt::format(
        "{}{}{} = {} cannot be used: it is a constant of a method now, and no method has it "
        "together with the other ones (the nearest is {}); leave it out, set density.strategy to "
        "one of {}, "
        "or write a method (docs/develop/extending.md)",
        setting.where, kSection, setting.rule, shown_word(setting.text), nearest,
        growth_method_words()));
  };
  GrowthMethod wanted = growth_method(strategy);
  for (const Setting& setting : settings_) {
    if (!counted(setting.rule, named)) continue;
    bool is_put = false;
    visit_rules(wanted, [&]<class T>(std::string_view name, T& value) {
      if (name != setting.rule) return;
      if constexpr (std::is_enum_v<T>) {
        const std::optional<T> known = value_of_word<T>(setting.word.value_or(""));
        is_put = known.has_value();
        value = known.value_or(value);
      } else {
        is_put = setting.number.has_value() && std::abs(*setting.number) < 1e9;
        if (is_put) value = T(*setting.number);
      }
    });
    if (!is_put) throw refusal(setting, strategy);
  }
  const RuleTexts texts = texts_of(wanted);
  const auto equals = [&](std::string_view name) {
    return growth_method(name).relocates == wanted.relocates &&
           differences(texts, texts_of(growth_method(name))).empty();
  };
  if (equals(strategy)) return strategy;
  GrowthMethod former = default_method();
  former.most_growth = kFormerMostGrowth;
  if (differences(texts, texts_of(former)).empty()) return "growth";
  std::string nearest = strategy;
  std::size_t fewest = differences(texts, texts_of(growth_method(strategy))).size();
  for (const NamedMethod& row : growth_methods()) {
    if (row.method.relocates != wanted.relocates) continue;
    if (equals(row.name)) return row.name;
    const std::size_t count = differences(texts, texts_of(row.method)).size();
    if (count < fewest) nearest = row.name, fewest = count;
  }
  const auto names = differences(texts, texts_of(growth_method(nearest)));
  const auto first = std::find_if(settings_.begin(), settings_.end(), [&](const Setting& setting) {
    return std::find(names.begin(), names.end(), setting.rule) != names.end();
  });
  throw refusal(first == settings_.end() ? settings_.front() : *first, nearest);
}

}  // namespace gs
