// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/scene_views.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>

#include "gs_core/error.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

// Of a file that a run wrote; what is wrong with it is not shown.
constexpr const char* kRemedyOfScenes = "train again";

// The most frequent picture size, and how many others there are.
std::string size_text(const Json& cameras) {
  std::map<std::pair<double, double>, int> counts;
  for (const Json& camera : cameras) ++counts[{camera.at("width"), camera.at("height")}];
  if (counts.empty()) return "";
  const auto most =
      std::max_element(counts.begin(), counts.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  const std::string text = fmt::format("{}x{}", most->first.first, most->first.second);
  const std::size_t others = counts.size() - 1;
  if (others == 0) return text;
  return fmt::format("{} and {} other size{}", text, others, others == 1 ? "" : "s");
}

// {"scene_hash", "train_views", "test_views", "size"}; null if a file is damaged.
Json views_of(const Json& run) {
  const RunFolder folder(run.at("folder").get<std::string>());
  const std::filesystem::path split_file = folder.split();
  try {
    const Json split = read_json_as(split_file, kRemedyOfScenes);
    const Json cameras = read_json_as(folder.cameras(), kRemedyOfScenes);
    return take_from_json(split_file, kRemedyOfScenes, [&] {
      return Json{{"scene_hash", run.at("results").value("scene_hash", "")},
                  {"train_views", split.at("train").size()},
                  {"test_views", split.at("test").size()},
                  {"size", size_text(cameras)}};
    });
  } catch (const Error&) {
    return nullptr;
  }
}

bool has_views(const Json& entry, const Json& views) {
  return std::all_of(views.items().begin(), views.items().end(),
                     [&](const auto& item) { return entry.at(item.key()) == item.value(); });
}

}  // namespace

Json views_json(const std::string& scene, const Json& runs) {
  Json entries = Json::array();
  for (const Json& run : runs) {
    if (run.at("scene") != scene || run.at("results").is_null()) continue;
    const Json views = views_of(run);
    if (views.is_null()) continue;
    auto entry = std::find_if(entries.begin(), entries.end(),
                              [&](const Json& each) { return has_views(each, views); });
    if (entry == entries.end()) {
      Json first = {{"configs", Json::array()}};
      first.update(views);
      entries.push_back(first);
      entry = entries.end() - 1;
    }
    Json& configs = (*entry)["configs"];
    if (std::find(configs.begin(), configs.end(), run.at("config")) == configs.end())
      configs.push_back(run.at("config"));
  }
  return entries;
}

}  // namespace gs
