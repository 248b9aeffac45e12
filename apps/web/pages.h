// SPDX-License-Identifier: Apache-2.0
// The pages of apps/web as strings that the program carries. apps/web/build.mjs bundles them.
#pragma once

#include <string_view>

namespace gs {

/// The report's page, with kDataPlace where its data goes. Empty in a build without npm.
std::string_view report_template();

inline constexpr std::string_view kDataPlace = "@GEMSPLAT_DATA@";

/// The studio's page (gs_app/studio). Empty in a build without npm.
std::string_view studio_page();

/// The viewer's page, which asks its server for everything else. Empty in a build without npm.
std::string_view view_page();

}  // namespace gs
