// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/photo_light.h"

#include <spdlog/fmt/fmt.h>

namespace gs {
namespace {

// Chosen by three scenes (docs/lab/2026-11-photometric.md): of one the photos differ by 8.2 % and,
// under exposures, by 3.2 %; of two by 5.1 % and 4.1 %, and by 5.8 % and 4.6 %.
constexpr double kFewestDifference = 0.06;  // of a point's colors, relative
constexpr double kFewestExplained = 1.5;    // times as much without exposures as with them

}  // namespace

PhotometricChoice choose_photometric(const std::optional<ExposureSummary>& exposure,
                                     const std::string& unknown_because) {
  if (!exposure)
    return {false, fmt::format("it is not known how much the photos differ in light, because {}",
                               unknown_because)};
  const double before = exposure->spread_before, after = exposure->spread_after;
  const bool differs = before >= kFewestDifference, explains = before >= kFewestExplained * after;
  const char* verdict = !differs   ? "the photos hardly differ in light"
                        : explains ? "the photos differ in light"
                                   : "the photos differ, and light explains little of it";
  return {
      differs && explains,
      fmt::format("{}: a point's colors differ by {:.1f} % between photos, and by {:.1f} % under "
                  "solved exposures",
                  verdict, 100 * before, 100 * after)};
}

}  // namespace gs
