// SPDX-License-Identifier: Apache-2.0
#include "gs_core/log.h"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

namespace gs {

void setup_log(Verbosity verbosity) {
  auto logger = spdlog::get("gemsplat");
  if (!logger) logger = spdlog::stderr_color_mt("gemsplat");
  logger->set_pattern("%^%v%$");
  logger->set_level(verbosity == Verbosity::quiet     ? spdlog::level::warn
                    : verbosity == Verbosity::verbose ? spdlog::level::debug
                                                      : spdlog::level::info);
  spdlog::set_default_logger(logger);
}

void detail::log_line(LogLevel level, std::string_view line) {
  const spdlog::string_view_t text(line.data(), line.size());
  switch (level) {
    case LogLevel::info: return spdlog::info(text);
    case LogLevel::warning: return spdlog::warn(text);
    case LogLevel::error: return spdlog::error(text);
  }
}

}  // namespace gs
