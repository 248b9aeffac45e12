// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/text/region_text.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

// Takes the text up to `mark` off the beginning of `rest`, and the mark.
std::string_view take_word(std::string_view& rest, char mark) {
  const std::size_t end = std::min(rest.find(mark), rest.size());
  std::string_view word = rest.substr(0, end);
  rest.remove_prefix(std::min(end + 1, rest.size()));
  while (!word.empty() && word.front() == ' ') word.remove_prefix(1);
  while (!word.empty() && word.back() == ' ') word.remove_suffix(1);
  return word;
}

std::optional<WideHalfSpace> parse_half_space(std::string_view text) {
  std::array<double, 4> numbers{};
  for (double& number : numbers) {
    const std::string_view word = take_word(text, ',');
    const auto [end, failure] = std::from_chars(word.data(), word.data() + word.size(), number);
    if (failure != std::errc() || end != word.data() + word.size() || !std::isfinite(number))
      return std::nullopt;
  }
  const auto [x, y, z, offset] = numbers;
  if (!text.empty() || (x == 0 && y == 0 && z == 0)) return std::nullopt;
  return WideHalfSpace{{x, y, z}, offset};
}

}  // namespace

std::optional<std::vector<WideHalfSpace>> parse_region(std::string_view text) {
  std::vector<WideHalfSpace> half_spaces;
  while (!text.empty()) {
    const std::optional<WideHalfSpace> parsed = parse_half_space(take_word(text, ';'));
    if (!parsed || half_spaces.size() == std::size_t(Region::kMost)) return std::nullopt;
    half_spaces.push_back(*parsed);
  }
  return half_spaces;
}

std::string text_of_region(const std::vector<WideHalfSpace>& half_spaces) {
  std::string text;
  for (const auto& [normal, offset] : half_spaces)
    text += fmt::format("{}{},{},{},{}", text.empty() ? "" : "; ", normal.x, normal.y, normal.z,
                        offset);
  return text;
}

Region region_in_scene(const std::vector<WideHalfSpace>& half_spaces, const Vec3d& world_offset) {
  GS_CHECK(half_spaces.size() <= std::size_t(Region::kMost));
  Region region;
  for (const auto& [normal, offset] : half_spaces)
    region.half_spaces[region.count++] = {Vec3f(normal), offset - inner(normal, world_offset)};
  return region;
}

Region region_of(const DensityConfig& density, const Vec3d& world_offset) {
  const auto half_spaces = parse_region(density.region);
  if (!half_spaces)
    throw UsageError("density.region is " + shown_word(density.region) +
                     ", which is no list of half-spaces such as \"0,0,1,2.5; 1,0,0,-4\"");
  return region_in_scene(*half_spaces, world_offset);
}

}  // namespace gs
