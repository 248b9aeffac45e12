// SPDX-License-Identifier: Apache-2.0
// How much memory this machine has, and how much of it photos may take.
#pragma once

#include <cstddef>

#include "gs_core/config/config.h"

namespace gs {

inline constexpr double kGib = 1024.0 * 1024.0 * 1024.0;  // bytes

/// Bytes of the machine's memory, or of what its control group (a container, a batch job) may take of it.
std::size_t host_ram_bytes();

/// dataset.photo_ram_gib in bytes; where it is 0, half of host_ram_bytes().
std::size_t photo_ram_bytes(const DatasetConfig& dataset);

}  // namespace gs
