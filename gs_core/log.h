// SPDX-License-Identifier: Apache-2.0
// Messages while the program works, on standard error, through spdlog. Results go to standard
// output.
#pragma once

#include <spdlog/spdlog.h>

namespace gs {

/// The log levels of the command line: quiet shows warnings and errors only.
enum class Verbosity { quiet, normal, verbose };

/// Sends the log to standard error, one plain line per message. Call it in main(), and again to
/// change the level.
void setup_log(Verbosity verbosity);

template <class... Args>
void log_info(fmt::format_string<Args...> format, Args&&... args) {
  spdlog::info(fmt::runtime(fmt::string_view(format)), std::forward<Args>(args)...);
}
template <class... Args>
void log_warning(fmt::format_string<Args...> format, Args&&... args) {
  spdlog::warn(fmt::runtime(fmt::string_view(format)), std::forward<Args>(args)...);
}
template <class... Args>
void log_error(fmt::format_string<Args...> format, Args&&... args) {
  spdlog::error(fmt::runtime(fmt::string_view(format)), std::forward<Args>(args)...);
}

}  // namespace gs
