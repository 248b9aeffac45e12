// SPDX-License-Identifier: Apache-2.0
// The pages of web/ as the program carries them, bundled by apps/web/build.mjs.
#pragma once

#include <string_view>

namespace gs {

/// The report's page, with kDataPlace where its data goes; empty in a build without npm.
std::string_view report_template();

inline constexpr std::string_view kDataPlace = "@GEMSPLAT_DATA@";

/// The viewer's page, which asks the server that it came from for all else; empty in a build without npm.
std::string_view view_page();

}  // namespace gs
