// SPDX-License-Identifier: Apache-2.0
// What a run will take of the machine, before it starts.
#pragma once

#include <string>

#include "gs_core/config/config.h"

namespace gs {

/// Memory, time and disk in a sentence, from the bytes of all photos, decoded with their masks, and a photo's mean size.
std::string forecast(const Config& config, double photo_bytes, double megapixels);

}  // namespace gs
