// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/experiment_grid.h"

#include <spdlog/fmt/fmt.h>

#include <cctype>

#include "gs_core/config/text/read_toml.h"
#include "gs_core/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Calls visit("density.every", node) for each leaf.
template <class Visitor>
void visit_leaves(const toml::table& table, const std::string& prefix, Visitor&& visit) {
  for (const auto& [key, node] : table) {
    const std::string name = prefix + std::string(key.str());
    if (const toml::table* inner = node.as_table()) {
      visit_leaves(*inner, name + ".", visit);
    } else {
      visit(name, node);
    }
  }
}

}  // namespace

std::string place_in(const fs::path& file, const toml::node& node) {
  return fmt::format("{}:{}: ", file.string(), node.source().begin.line);
}

void refuse_runs(const std::string& place) {
  throw UsageError(fmt::format(
      "{}scenes, configs and seeds make more than {} runs; leave out values of a grid, or divide "
      "the file into several",
      place, kMostRuns));
}

std::string value_text(const toml::node& node) {
  if (const auto text = node.value_exact<std::string>()) return *text;
  return text_of(node);
}

std::string folder_name(std::string text) {
  for (char& c : text)
    if (!std::isalnum(static_cast<unsigned char>(c)) &&
        std::string_view("._+=-").find(c) == std::string_view::npos)
      c = '_';
  if (text.empty() || text[0] == '.') text = fmt::format("_{}", text);
  return text;
}

std::vector<PlacedSetting> flat_settings(const fs::path& file, const toml::table& table) {
  std::vector<PlacedSetting> settings;
  visit_leaves(table, "", [&](const std::string& key, const toml::node& node) {
    settings.push_back({key + "=" + text_of(node), place_in(file, node)});
  });
  return settings;
}

std::vector<ExperimentConfig> unrolled(const fs::path& file, const ExperimentConfig& config,
                                       const toml::table& grid) {
  std::vector<ExperimentConfig> points = {config};
  visit_leaves(grid, "", [&](const std::string& key, const toml::node& node) {
    const toml::array* values = node.as_array();
    if (!values || values->empty())
      throw UsageError(place_in(file, node) + key + " in a grid must be a list of values");
    if (values->size() > kMostRuns / points.size()) refuse_runs(place_in(file, node));
    std::vector<ExperimentConfig> finer;
    for (const ExperimentConfig& point : points)
      for (const toml::node& value : *values) {
        ExperimentConfig next = point;
        next.name +=
            folder_name(fmt::format("+{}={}", key.substr(key.rfind('.') + 1), value_text(value)));
        next.settings.push_back({key + "=" + text_of(value), place_in(file, value)});
        finer.push_back(std::move(next));
      }
    points = std::move(finer);
  });
  return points;
}

}  // namespace gs
