// SPDX-License-Identifier: Apache-2.0
// "Did you mean ...?": the known word nearest to a mistyped one.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// How many single-letter insertions, deletions and substitutions turn one word into the other
/// (Levenshtein 1966).
int edit_distance(std::string_view a, std::string_view b);

/// The word of `known` nearest to `word`, the first of equally near ones; empty if none is near
/// enough to be meant. Words with dots ("section.name") are also compared by their last part alone.
std::string nearest_word(std::string_view word, const std::vector<std::string>& known);

}  // namespace gs
