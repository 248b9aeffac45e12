// SPDX-License-Identifier: Apache-2.0
#include "gs_core/density/growth_method.h"

#include <iterator>

#include "gs_core/error.h"

namespace gs {

NamedMethods growth_methods() {
  static const NamedMethod table[] = {
      {"growth", default_method()},
      {"adaptive", adaptive_method()},
      {"absgs", absgs_method()},
      {"dash_gaussian", dash_gaussian_method()},
      {"fastgs", fastgs_method()},
      {"improved_gs", improved_gs_method()},
      {"litegs", litegs_method()},
      {"mcmc", mcmc_method()},
      {"speedy_splat", speedy_splat_method()},
      {"taming", taming_method()},
  };
  return {std::begin(table), std::end(table)};
}

std::string_view growth_method_words() {
  static const std::string words = [] {
    std::string joined;
    for (const NamedMethod& row : growth_methods())
      joined.append(joined.empty() ? "" : ", ").append(row.name);
    return joined;
  }();
  return words;
}

const GrowthMethod& growth_method(std::string_view strategy) {
  for (const NamedMethod& row : growth_methods())
    if (strategy == row.name) return row.method;
  throw UsageError("there is no density.strategy " + std::string(strategy) + "; it is one of " +
                   std::string(growth_method_words()));
}

}  // namespace gs
