// SPDX-License-Identifier: Apache-2.0
// report.html: data, and the page around it that web/ makes.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

namespace gs {

/// Whether this build carries the page. Where it does not, cannot_write_reports() says so, and what to do.
bool can_write_reports();
std::string cannot_write_reports();

/// The page with its data. Whatever the data says stays data: it cannot end the element that it stands in.
std::string report_page(const nlohmann::ordered_json& data);

/// Writes the page, whole or not at all. Throws Error, also where this build has no page.
void write_report(const std::filesystem::path& file, const nlohmann::ordered_json& data);

/// {"version", "commit", "date"} of the program that writes the report, now.
nlohmann::ordered_json made_by();

}  // namespace gs
