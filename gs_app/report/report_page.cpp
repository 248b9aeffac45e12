// SPDX-License-Identifier: Apache-2.0
#include "gs_app/report/report_page.h"

#include <algorithm>
#include <fstream>
#include <string_view>

#include "apps/web/pages.h"
#include "gs_app/run/page_text.h"
#include "gs_app/run/provenance.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/error.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"

namespace gs {

constexpr std::size_t kTellingBytes = 256;  // at the start of a report

bool can_write_reports() { return !report_template().empty(); }

std::string cannot_write_reports() {
  return "this build has no report page, because npm was missing: install npm and build again, or "
         "use "
         "`gemsplat report` of another build on the same folder";
}

std::string report_page(const Json& data) {
  std::string page(report_template());
  const std::size_t place = page.find(kDataPlace);
  GS_CHECK(place != page.npos);
  return page.replace(place, kDataPlace.size(), script_json(data));
}

namespace {

// Whether a file begins as a report of this version does; another may be the user's.
bool is_report(const std::filesystem::path& file) {
  const std::string_view page = report_template();
  std::string start(std::min<std::size_t>(page.find(kDataPlace), kTellingBytes), '\0');
  std::ifstream stream(file, std::ios::binary);
  return stream.read(start.data(), std::streamsize(start.size())) && page.starts_with(start);
}

}  // namespace

void write_report(const std::filesystem::path& file, const Json& data) {
  if (!can_write_reports()) throw Error(cannot_write_reports());
  if (std::filesystem::exists(file) && !is_report(file))
    log_info("the older {} is now {}", file.string(), keep_aside(file).string());
  write_text(file, report_page(data));
}

Json made_by() { return {{"version", kVersion}, {"commit", built_commit()}, {"date", utc_date()}}; }

}  // namespace gs
