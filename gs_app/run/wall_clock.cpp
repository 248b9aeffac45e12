// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/wall_clock.h"

#include <unistd.h>

#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iterator>
#include <sstream>

namespace gs {

// Linux tells the begin in ticks after it was started itself: field 22, the twentieth behind the
// name, which is in parentheses.
WallClock::Clock::time_point process_begin() {
  const WallClock::Clock::time_point now = WallClock::Clock::now();
  std::ifstream file("/proc/self/stat");
  const std::string text(std::istreambuf_iterator<char>(file), {});
  const std::size_t name_end = text.rfind(')');
  timespec up{};
  if (name_end == text.npos || clock_gettime(CLOCK_BOOTTIME, &up) != 0) return now;
  std::istringstream fields(text.substr(name_end + 1));
  std::string field;
  for (int i = 0; i < 20; ++i) fields >> field;
  const double ticks = double(std::atoll(field.c_str())), per_second = double(sysconf(_SC_CLK_TCK));
  const double age = double(up.tv_sec) + 1e-9 * double(up.tv_nsec) - ticks / per_second;
  if (!fields || !(age > 0 && per_second > 0)) return now;
  return now -
         std::chrono::duration_cast<WallClock::Clock::duration>(std::chrono::duration<double>(age));
}

}  // namespace gs
