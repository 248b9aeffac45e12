// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdlib>

#include "gs_core/error.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

void write_with_spdlog(detail::LogLevel level, std::string_view line) {
  const std::string text = in_color(level, wrapped_for_stderr(line), stderr_has_color());
  switch (level) {
    case detail::LogLevel::info: return spdlog::info(text);
    case detail::LogLevel::warning: return spdlog::warn(text);
    case detail::LogLevel::error: return spdlog::error(text);
  }
}

void (*log_sink)(detail::LogLevel, std::string_view) = write_with_spdlog;

}  // namespace

bool stderr_has_color() {
  const char* const no_color = std::getenv("NO_COLOR");
  const char* const terminal = std::getenv("TERM");
  return !(no_color && *no_color) && terminal && std::string_view(terminal) != "dumb" &&
         ::isatty(STDERR_FILENO) == 1;
}

std::string wrapped_for_stderr(std::string_view text, std::size_t start) {
  winsize size{};
  if (::isatty(STDERR_FILENO) != 1 || ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 ||
      size.ws_col == 0)
    return std::string(text);
  return wrapped_at(text, size.ws_col, start);
}

std::string in_color(detail::LogLevel level, std::string_view text, bool enabled) {
  if (!enabled || level == detail::LogLevel::info) return std::string(text);
  const char* const red = "\033[31m";
  const char* const yellow = "\033[33m";
  return fmt::format("{}{}\033[0m", level == detail::LogLevel::error ? red : yellow, text);
}

void setup_log(Verbosity verbosity) {
  auto logger = spdlog::get("gemsplat");
  if (!logger) logger = spdlog::stderr_logger_mt("gemsplat");
  logger->set_pattern("%v");
  logger->set_level(verbosity == Verbosity::quiet     ? spdlog::level::warn
                    : verbosity == Verbosity::verbose ? spdlog::level::debug
                                                      : spdlog::level::info);
  spdlog::set_default_logger(logger);
}

void detail::log_line(LogLevel level, std::string_view line) {
  log_sink(level, printable(std::string(line)));
}

void detail::set_log_sink(void (*sink)(LogLevel, std::string_view)) {
  log_sink = sink ? sink : write_with_spdlog;
}

}  // namespace gs
