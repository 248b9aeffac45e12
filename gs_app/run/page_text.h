// SPDX-License-Identifier: Apache-2.0
// Data as text inside of an HTML page.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "gs_core/system/text/json.h"

namespace gs {

/// Base 64 with padding (RFC 4648, section 4).
std::string base64_of(const std::vector<std::uint8_t>& bytes);

/// Text that may stand between tags.
std::string html_text(const std::string& text);

/// JSON that may stand in a script element, whatever its strings hold. Strings that are no UTF-8
/// are mended.
std::string script_json(const Json& data);

}  // namespace gs
