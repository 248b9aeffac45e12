// SPDX-License-Identifier: Apache-2.0
// Messages while the program works, on standard error, through spdlog. Results go to standard
// output.
#pragma once

#include <spdlog/fmt/fmt.h>

#include <string>
#include <string_view>
#include <utility>

namespace gs {

/// The log levels of the command line: quiet shows warnings and errors only.
enum class Verbosity { quiet, normal, verbose };

/// Sends the log to standard error, one plain line per message. Call it in main(), and again to
/// change the level.
void setup_log(Verbosity verbosity);

namespace detail {
enum class LogLevel { info, warning, error };
/// Writes one line. Only log.cpp sees spdlog, whose headers would take seconds in every file.
void log_line(LogLevel level, std::string_view line);
/// Sends the lines elsewhere: a module that is loaded at run time sends its own to the program's.
/// Null: to standard error again.
void set_log_sink(void (*sink)(LogLevel, std::string_view));
}  // namespace detail

/// Whether messages get colors: standard error is a terminal that has colors, and NO_COLOR is unset
/// or empty (no-color.org).
bool stderr_has_color();

/// The text as standard error shows it best: on a terminal wrapped at its width, behind `start`
/// columns; elsewhere as it is.
std::string wrapped_for_stderr(std::string_view text, std::size_t start = 0);

/// The text in the color of its level: errors are red, warnings yellow. Other text, and all text
/// if not `enabled`, is returned as it is.
std::string in_color(detail::LogLevel level, std::string_view text, bool enabled);

template <class... Args>
void log_info(fmt::format_string<Args...> format, Args&&... args) {
  detail::log_line(detail::LogLevel::info, fmt::format(format, std::forward<Args>(args)...));
}
template <class... Args>
void log_warning(fmt::format_string<Args...> format, Args&&... args) {
  detail::log_line(detail::LogLevel::warning, fmt::format(format, std::forward<Args>(args)...));
}
template <class... Args>
void log_error(fmt::format_string<Args...> format, Args&&... args) {
  detail::log_line(detail::LogLevel::error, fmt::format(format, std::forward<Args>(args)...));
}

}  // namespace gs
