// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

namespace gs {

/// Opens the browser if that is wished, or by default if there is a desktop. It is detached, so that
/// Ctrl-C ends only this program. A wish that fails becomes a warning.
void open_browser(const std::string& url, std::optional<bool> wish);

}  // namespace gs
