// SPDX-License-Identifier: Apache-2.0
// Writes report.html: the page that apps/web makes, with the report's data in it.
#pragma once

#include <filesystem>
#include <string>

#include "gs_core/system/text/json.h"

namespace gs {

/// Whether this build contains the page. If not, cannot_write_reports() says so and what to do.
bool can_write_reports();
std::string cannot_write_reports();

/// The page with `data` in it, escaped so that no text in the data can end its <script> element.
std::string report_page(const Json& data);

/// Writes the page, whole or not at all. Throws Error, also if this build has no page.
void write_report(const std::filesystem::path& file, const Json& data);

/// {"version", "commit", "date"}: of this program, and the current date.
Json made_by();

}  // namespace gs
