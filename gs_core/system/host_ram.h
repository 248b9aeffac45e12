// SPDX-License-Identifier: Apache-2.0
// How much memory this machine has, and how much of it photos may take.
#pragma once

#include <cstddef>

namespace gs {

/// Bytes of the machine's memory, or the limit of its control group (a container, a batch job) if
/// that is lower.
std::size_t host_ram_bytes();

/// dataset.photo_ram_gib in bytes; half of host_ram_bytes() if it is 0.
std::size_t photo_ram_bytes(double photo_ram_gib);

}  // namespace gs
