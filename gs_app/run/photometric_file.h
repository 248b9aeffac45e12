// SPDX-License-Identifier: Apache-2.0
// photometric.json: what a run has learned of its photos' exposure and white balance, for people
// and for `gemsplat eval`.
#pragma once

#include <filesystem>

#include "gs_eval/looks/scene_looks.h"

namespace gs {

/// {"model", "photos": {name: {"camera", number: value, ...}, ...}, "held_out": {the same}, "rule",
/// "spreads": {rule: spread, ...}}. docs/method/photometric.md says what the numbers mean. Written
/// whole or not at all. Throws Error.
void write_photometric(const std::filesystem::path& path, const SceneLooks& looks);

/// Throws Error that names the file.
SceneLooks read_photometric(const std::filesystem::path& path);

}  // namespace gs
