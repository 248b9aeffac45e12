// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/parts/open_browser.h"

#include <cstdlib>

#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/processes/process.h"

namespace gs {
namespace {

bool has_desktop() {
  const auto is_set = [](const char* name) {
    const char* const value = std::getenv(name);
    return value && *value;
  };
  return is_set("DISPLAY") || is_set("WAYLAND_DISPLAY");
}

}  // namespace

void open_browser(const std::string& url, std::optional<bool> wish) {
  if (!wish.value_or(has_desktop())) return;
  try {
    start_child({"xdg-open", url}, {.is_detached = true});
  } catch (const Error& error) {
    if (wish) log_warning("cannot open a browser: {}; open {} yourself", error.what(), url);
  }
}

}  // namespace gs
