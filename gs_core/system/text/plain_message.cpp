// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/text/plain_message.h"

#include <filesystem>
#include <new>
#include <system_error>

#include "gs_core/error.h"

namespace gs {

std::string plain_message(const std::exception& error) {
  if (dynamic_cast<const std::bad_alloc*>(&error)) return "out of memory";
  if (const auto* of_file = dynamic_cast<const std::filesystem::filesystem_error*>(&error))
    return printable("cannot get at " + of_file->path1().string() + ": " +
                     of_file->code().message());
  if (const auto* of_system = dynamic_cast<const std::system_error*>(&error))
    return printable(of_system->code().message());
  return printable(error.what());
}

}  // namespace gs
