// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/text/nearest_word.h"

#include <algorithm>
#include <numeric>

namespace gs {
namespace {

std::string_view last_part(std::string_view word) {
  return word.substr(word.rfind('.') + 1);  // npos + 1 is 0: the whole word
}

}  // namespace

int edit_distance(std::string_view a, std::string_view b) {
  std::vector<int> row(b.size() + 1);  // from the first i letters of a to each prefix of b
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    int diagonal = row[0];
    row[0] = int(i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const int substituted = diagonal + (a[i - 1] != b[j - 1]);
      diagonal = row[j];
      row[j] = std::min({substituted, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row[b.size()];
}

std::string nearest_word(std::string_view word, const std::vector<std::string>& known) {
  constexpr std::size_t kLongest = 200;  // letters; a longer word is no slip of the pen
  if (word.size() > kLongest) return "";
  // A third of the letters may be wrong (two in short words), and a wrong section costs as much as
  // one.
  const auto allowed = [](std::string_view text) { return std::max(2, int(text.size()) / 3); };
  int best = std::max(allowed(word), allowed(last_part(word)) + 1) + 1;
  std::string nearest;
  for (const std::string& candidate : known) {
    const int whole = edit_distance(word, candidate);
    const int part = edit_distance(last_part(word), last_part(candidate));
    const bool near = whole <= allowed(word) || part <= allowed(last_part(word));
    const int distance = std::min(whole, part + 1);
    if (near && distance < best) {
      best = distance;
      nearest = candidate;
    }
  }
  return nearest;
}

}  // namespace gs
