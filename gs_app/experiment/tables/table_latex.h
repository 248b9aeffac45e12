// SPDX-License-Identifier: Apache-2.0
// results.tex of an experiment: the tables of a paper.
#pragma once

#include <string>

#include "gs_app/experiment/tables/table_cells.h"

namespace gs {

/// What results.tex shows. The last two may have no rows.
struct PaperTables {
  TextTable means, scene_means, differences;
  std::string baseline;  // of the differences
};

/// Each table as a `table` with caption and `tabular`. A document needs the package booktabs.
/// Names may have any characters.
std::string experiment_latex(const std::string& title, const PaperTables& tables);

}  // namespace gs
