// SPDX-License-Identifier: Apache-2.0
#include "gs_core/error.h"

#include "gs_core/system/text/foreign_text.h"

namespace gs {

std::string printable(std::string text) { return fit_for_terminal(text, kLongestMessage); }

namespace detail {

void check_failed(const char* condition, const char* file, int line) {
  throw std::logic_error(std::string("internal error: ") + condition + " does not hold at " + file +
                         ":" + std::to_string(line) + "; please report this");
}

}  // namespace detail
}  // namespace gs
