// SPDX-License-Identifier: Apache-2.0
// With what a run was made: the program, the machine, the day.
#pragma once

#include <cstddef>
#include <string>

namespace gs {

/// The commit that this program was built from, "-dirty" behind it where files had changed; "unknown" without git.
/// Written at each build (scripts/cmake/write_commit.cmake).
const char* built_commit();

/// The CPU's name as the system tells it; "unknown" where it does not.
std::string cpu_name();

/// The version of NVIDIA's driver, without asking the driver itself; empty where there is none.
std::string gpu_driver();

/// Now, as "2026-01-31T12:00:00Z".
std::string utc_date();

/// The memory of the machine that this process holds now (its resident set), in bytes; 0 where the system does not tell.
std::size_t host_bytes();

/// The most memory of the machine that this process has held at once (its peak resident set), in bytes.
std::size_t peak_host_bytes();

}  // namespace gs
