// SPDX-License-Identifier: Apache-2.0
// Tables of things that a setting names: strategies of density control, losses, words of the
// renderer.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "gs_core/error.h"

namespace gs {

/// The names of a table, in its order. A row has a member `name`.
template <class Row, std::size_t size>
std::vector<std::string> names_of(const Row (&table)[size]) {
  std::vector<std::string> names;
  for (const Row& row : table) names.emplace_back(row.name);
  return names;
}

/// The row of this name, never null. Throws a UsageError that lists the names which are there, for
/// example "there is no density.strategy mcmcc; it is one of adaptive, mcmc". A pointer, because g++
/// 13 takes a reference for one into the temporary strings among the arguments, and warns.
template <class Row, std::size_t size>
const Row* row_named(const Row (&table)[size], const std::string& name, const std::string& key,
                     const std::string& where = "") {
  std::string known;
  for (const Row& row : table) {
    if (name == row.name) return &row;
    known += (known.empty() ? "" : ", ") + std::string(row.name);
  }
  throw UsageError("there is no " + key + " " + name + where + "; it is one of " + known);
}

}  // namespace gs
