// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "gs_core/system/log.h"

namespace gs {

/// Keeps the lines of the log while it lives.
class CapturedLog {
 public:
  CapturedLog() {
    text_.clear();
    detail::set_log_sink([](detail::LogLevel, std::string_view line) { text_ += line; });
  }
  ~CapturedLog() { detail::set_log_sink(nullptr); }
  const std::string& text() const { return text_; }

 private:
  static inline std::string text_;
};

}  // namespace gs
