// SPDX-License-Identifier: Apache-2.0
#include "gs_core/error.h"

namespace gs::detail {

void check_failed(const char* condition, const char* file, int line) {
  throw std::logic_error(std::string("internal error: ") + condition + " does not hold at " + file +
                         ":" + std::to_string(line) + "; please report this");
}

}  // namespace gs::detail
