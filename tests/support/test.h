// SPDX-License-Identifier: Apache-2.0
// What nearly every test includes, so that no file begins with the same twenty lines: googletest and
// its matchers, the standard library, threads, and what an Error says. A file with only this header
// or another one of this folder may use all that they include.
#pragma once

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "tests/support/error_of.h"

namespace gs {

using testing::AllOf;
using testing::ElementsAre;
using testing::ElementsAreArray;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::ThrowsMessage;

inline constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// An action that throws an Error of this exit code.
inline auto FailsWith(ExitCode code) {
  return testing::Throws<Error>(testing::Property(&Error::code, code));
}

/// What `make` makes while so many threads work; 0: as many as there are cores.
template <std::invocable Make>
auto with_threads(int count, Make&& make) {
  const int before = thread_count();
  set_thread_count(count);
  auto made = make();
  set_thread_count(before);
  return made;
}

}  // namespace gs
