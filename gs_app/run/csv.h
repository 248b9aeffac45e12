// SPDX-License-Identifier: Apache-2.0
// Small files of comma-separated values: what a run writes as it goes on, and what is made of it later.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// A text as one cell: in quotes where it has to be.
std::string csv_cell(const std::string& text);

/// The cells of one line, without quotes.
std::vector<std::string> csv_cells(std::string_view line);

/// The whole rows of a file up to a step, their first cell. A row is whole where it ends with a newline, which a kill may
/// have kept from it, and has as many cells as the header. Nothing where there is no file.
std::string csv_rows_up_to(const std::filesystem::path& file, std::string_view header, int step);

/// Adds rows at the end of a file. Throws Error.
void append_rows(const std::filesystem::path& file, const std::string& rows);

}  // namespace gs
