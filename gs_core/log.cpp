// SPDX-License-Identifier: Apache-2.0
#include "gs_core/log.h"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

namespace gs {
namespace {

void write_with_spdlog(detail::LogLevel level, std::string_view line) {
  const spdlog::string_view_t text(line.data(), line.size());
  switch (level) {
    case detail::LogLevel::info: return spdlog::info(text);
    case detail::LogLevel::warning: return spdlog::warn(text);
    case detail::LogLevel::error: return spdlog::error(text);
  }
}

void (*log_sink)(detail::LogLevel, std::string_view) = write_with_spdlog;

}  // namespace

void setup_log(Verbosity verbosity) {
  auto logger = spdlog::get("gemsplat");
  if (!logger) logger = spdlog::stderr_color_mt("gemsplat");
  logger->set_pattern("%^%v%$");
  logger->set_level(verbosity == Verbosity::quiet     ? spdlog::level::warn
                    : verbosity == Verbosity::verbose ? spdlog::level::debug
                                                      : spdlog::level::info);
  spdlog::set_default_logger(logger);
}

void detail::log_line(LogLevel level, std::string_view line) { log_sink(level, line); }

void detail::set_log_sink(void (*sink)(LogLevel, std::string_view)) { log_sink = sink; }

}  // namespace gs
