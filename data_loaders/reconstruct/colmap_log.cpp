// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/colmap_log.h"

#include <algorithm>
#include <charconv>
#include <deque>
#include <fstream>

#include "gs_core/system/text/ascii.h"

namespace gs {
namespace {

constexpr const char* kBlanks = " \t\r";

// What follows `key` in the line, without blanks at both ends.
std::optional<std::string_view> after(std::string_view line, std::string_view key) {
  const std::size_t at = line.find(key);
  if (at == line.npos) return std::nullopt;
  return trimmed(line.substr(at + key.size()), kBlanks);
}

constexpr std::int64_t kLargestCount = 1'000'000'000;  // of photos or blocks; more is another text

// Cuts a whole number off the front, and what stands before it.
std::optional<std::int64_t> take_number(std::string_view& text) {
  text.remove_prefix(std::min(text.find_first_of("0123456789"), text.size()));
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || value > kLargestCount) return std::nullopt;
  text.remove_prefix(std::size_t(end - text.data()));
  return value;
}

// "3/12]" or "1/4, 2/4]": blocks of rows and columns are counted one by one.
std::optional<ColmapCount> fraction(std::string_view text) {
  text = text.substr(0, text.find(']'));
  const auto row = take_number(text), rows = take_number(text);
  if (!row || !rows) return std::nullopt;
  const auto column = take_number(text), columns = take_number(text);
  if (!column || !columns) return ColmapCount{*row, *rows};
  return ColmapCount{(*row - 1) * *columns + *column, *rows * *columns};
}

// The photo whose features are listed; a resumed run names it again.
void add_photo(ColmapLog& log, std::string_view name, int features) {
  const auto same = [&](const ColmapLog::Photo& photo) { return photo.name == name; };
  if (std::none_of(log.photos.begin(), log.photos.end(), same))
    log.photos.push_back({std::string(name), features});
}

}  // namespace

std::optional<ColmapCount> colmap_count(std::string_view line) {
  for (const char* key : {"Processed file [", "Matching block [", "Processing block [",
                          "Matching image [", "Processing image ["})
    if (const auto rest = after(line, key)) return fraction(*rest);
  if (const auto rest = after(line, "Registering image #")) {
    std::string_view text = *rest;
    take_number(text);  // the id
    if (const auto done = take_number(text)) return ColmapCount{*done, 0};
  }
  return std::nullopt;
}

ColmapLog read_colmap_log(const std::filesystem::path& file) {
  ColmapLog log;
  std::ifstream stream(file);
  std::string name;
  std::int64_t tried = 0;
  for (std::string line; std::getline(stream, line);) {
    if (const auto value = after(line, " Name:")) {
      name = *value;
    } else if (auto features = after(line, " Features:")) {
      if (!name.empty()) add_photo(log, name, int(take_number(*features).value_or(0)));
      name.clear();
    } else if (auto id = after(line, "Registering image #")) {
      tried = take_number(*id).value_or(0);
    } else if (auto seen = after(line, "Image sees ")) {
      log.seen_points[std::uint32_t(tried)] = int(take_number(*seen).value_or(0));
    } else if (line.find("ailed to create sparse model") != line.npos) {
      log.no_model = true;
    } else if (line.find("colmap mapper") != line.npos) {  // a new attempt
      log.seen_points.clear();
      log.no_model = false;
    }
  }
  return log;
}

std::string last_lines(const std::filesystem::path& file, std::size_t count) {
  std::deque<std::string> lines;
  std::ifstream stream(file);
  for (std::string line; std::getline(stream, line);) {
    if (line.find_first_not_of(kBlanks) == line.npos) continue;
    lines.push_back(line);
    if (lines.size() > count) lines.pop_front();
  }
  std::string text;
  for (const std::string& line : lines) text += (text.empty() ? "  " : "\n  ") + line;
  return text;
}

}  // namespace gs
