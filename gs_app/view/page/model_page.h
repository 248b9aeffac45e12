// SPDX-License-Identifier: Apache-2.0
// One HTML file that shows a model without a server: the viewer's page (apps/web/view) with the
// model and the scene inside. A browser opens it from a disk; it loads nothing from the network.
//
//   check_model_page(file, force);                   // before the work starts
//   const ModelPage page = write_model_page(file, opened, config, sh_degree, title);
#pragma once

#include <cstdint>
#include <filesystem>

#include "gs_app/run/open_model.h"

namespace gs {

/// Bytes of the model inside at most. Browsers hold the page, its text and the model in memory at
/// the same time, and Chromium's strings end at 512 MB.
inline constexpr std::uint64_t kMostPageModelBytes = 250'000'000;

/// Whether an output is such a page: its name ends in .html, in upper or lower case.
bool is_model_page(const std::filesystem::path& file);

/// Throws UsageError where `file` exists and may not be moved aside (`force`); Error where this
/// build has no viewer page.
void check_model_page(const std::filesystem::path& file, bool force);

struct ModelPage {
  std::filesystem::path file;
  std::uint64_t bytes = 0;
  std::uint64_t model_bytes = 0;  // of the model inside, before it became text
  std::string_view format;        // of it
  std::size_t gaussians = 0;
};

/// Writes the page; an older file becomes FILE.bak-N. The model inside is a .sog, or an .spz with 8
/// bits of SH in a build without libwebp, or a .gs4d where it moves, of SH degree `sh_degree` at
/// most. The page is for visitors: it has no panels, and turns slowly over the arc that was
/// photographed until somebody touches it. An empty title stands for the name of the scene's folder,
/// or of the run if the scene lies in it. The page has the cameras of the run, without photos.
/// Throws Error, with a remedy, where the model is larger than kMostPageModelBytes.
ModelPage write_model_page(const std::filesystem::path& file, const OpenedModel& opened,
                           const Config& config, int sh_degree, const std::string& title);

/// "out/a.html: 7.1 MB, with 3.7 MB of .sog for 79,879 Gaussians; a browser opens it"
std::string summary(const ModelPage& page);

}  // namespace gs
