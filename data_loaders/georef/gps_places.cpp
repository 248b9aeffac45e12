// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/georef/gps_places.h"

#include <spdlog/fmt/fmt.h>

#include <array>
#include <optional>
#include <string_view>

#include "data_loaders/photos/photos.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/text/ascii.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

constexpr std::uint64_t kLargestGpsFile = std::uint64_t(64) << 20;  // bytes, a million photos
constexpr std::string_view kSpace = " \t\r";

/// Takes the last word off a line; empty where there is none.
std::string_view take_last_word(std::string_view& line) {
  const std::size_t end = line.find_last_not_of(kSpace);
  if (end == line.npos) return line = {};
  const std::size_t before = line.find_last_of(kSpace, end);
  const std::size_t begin = before == line.npos ? 0 : before + 1;
  const std::string_view word = line.substr(begin, end + 1 - begin);
  line = line.substr(0, begin);
  return word;
}

/// Three numbers at the end of a line, whose beginning stays in `line` as the name.
std::optional<Geodetic> take_place(std::string_view& line) {
  std::array<double, 3> numbers;  // latitude, longitude, height
  for (int i = 2; i >= 0; --i)
    if (!parse_number(take_last_word(line), numbers[std::size_t(i)])) return {};
  line = trimmed(line, kSpace);
  if (line.empty()) return {};
  const Geodetic place{numbers[1], numbers[0], numbers[2]};
  return is_on_earth(place) ? std::optional(place) : std::nullopt;
}

}  // namespace

GpsPlaces gps_places_of_photos(const std::vector<std::string>& names,
                               const std::vector<std::filesystem::path>& photos) {
  GpsPlaces places;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (!photos[i].empty())
      if (const auto place = read_photo_place(photos[i])) places[names[i]] = *place;
  return places;
}

GpsPlaces read_gps_file(const std::filesystem::path& path) {
  const std::string text = read_text_file(path, kLargestGpsFile);
  GpsPlaces places;
  std::size_t number = 0;
  for (std::size_t begin = 0; begin < text.size(); ++number) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    std::string_view line = std::string_view(text).substr(begin, end - begin);
    begin = end + 1;
    const std::size_t first = line.find_first_not_of(kSpace);
    if (first == line.npos || line[first] == '#') continue;
    const auto place = take_place(line);
    if (!place)
      cannot_read(path,
                  fmt::format("line {} is not NAME LATITUDE LONGITUDE HEIGHT, with degrees "
                              "and meters of a place on earth; correct it, or put # before it",
                              number + 1));
    if (!places.emplace(line, *place).second)
      cannot_read(path, fmt::format("line {} names {} again; remove one of its lines", number + 1,
                                    shown_word(std::string(line))));
  }
  return places;
}

}  // namespace gs
