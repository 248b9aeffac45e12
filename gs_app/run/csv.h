// SPDX-License-Identifier: Apache-2.0
// Small files of comma-separated values, such as metrics.csv.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// A text as one cell, in quotes if it holds a comma, a quote or a line end.
std::string csv_cell(const std::string& text);

/// The cells of one line, without their quotes.
std::vector<std::string> csv_cells(std::string_view line);

/// The text of a file; empty if there is none. Throws Error for what is no regular file, such as a
/// FIFO that nobody writes to, and for more than 1 GiB.
std::string csv_text(const std::filesystem::path& file);

/// The rows of a file whose first cell, a step, is at most `step`. Rows that are not whole are left
/// out: a kill may have cut off the newline or some cells. Empty if there is no file.
std::string csv_rows_up_to(const std::filesystem::path& file, std::string_view header, int step);

/// The step in the first cell of the last row that ends with a newline; 0 if there is none, or no
/// file that can be read.
int last_step_in(const std::filesystem::path& file);

/// Adds rows at the end of a file. Throws Error.
void append_rows(const std::filesystem::path& file, const std::string& rows);

}  // namespace gs
