// SPDX-License-Identifier: Apache-2.0
#include "gs_core/error.h"

namespace gs {

std::string printable(std::string text) {
  for (char& c : text)
    if ((static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t') || c == 0x7f) c = '?';
  return text;
}

namespace detail {

void check_failed(const char* condition, const char* file, int line) {
  throw std::logic_error(std::string("internal error: ") + condition + " does not hold at " + file +
                         ":" + std::to_string(line) + "; please report this");
}

}  // namespace detail
}  // namespace gs
