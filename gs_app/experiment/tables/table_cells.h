// SPDX-License-Identifier: Apache-2.0
// The tables of numbers as cells of text, which Markdown and LaTeX print.
#pragma once

#include <string>
#include <vector>

#include "gs_app/experiment/tables/table_differences.h"
#include "gs_app/experiment/tables/table_means.h"
#include "gs_app/experiment/tables/table_rows.h"

namespace gs {

struct TextTable {
  std::vector<std::string> titles;
  std::vector<std::vector<std::string>> rows;
  std::size_t names = 0;  // columns of names; the others are numbers: "25.31", "25.31 ± 0.12", "-"
};

/// Means ± standard deviations over seeds, for each scene and config.
TextTable table_of_means(const std::vector<Group>& groups, const std::vector<Metric>& metrics);

/// The same of the means over scenes, for each config.
TextTable table_of_scene_means(const std::vector<SceneMean>& means,
                               const std::vector<Metric>& metrics);

/// Mean differences ± standard errors, with signs.
TextTable table_of_differences(const std::vector<Comparison>& comparisons,
                               const std::vector<Metric>& metrics);

/// The values of every run.
TextTable table_of_runs(const std::vector<RunRow>& rows, const std::vector<Metric>& metrics);

}  // namespace gs
