// SPDX-License-Identifier: Apache-2.0
// The one way in which JSON is read: from files beside models, of runs, scenes and cameras. Whatever
// a file holds, it ends in a value or in an Error that names the file; no exception of nlohmann-json
// leaves this header's functions.
//
// Before a text is parsed, it is measured: how deep it nests (destructors and users recurse), how
// much memory the values take (`{}` takes 30 times its bytes), and how long the search for equal keys
// takes (an ordered object compares each key with all before it).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <type_traits>

#include "gs_core/system/text/json.h"

namespace gs {

inline constexpr std::uint64_t kLargestJson = std::uint64_t(128) << 20;  // bytes, 100,000 cameras
inline constexpr int kDeepestJson = 64;                                  // real files nest below 10

/// Throws Error for a text that nests too deep or would take too much memory or time. `remedy` ends
/// each message: "write it again". `searches_keys`: its objects compare each key with all before it.
void measure_json(const std::filesystem::path& path, std::string_view text, std::string_view remedy,
                  bool searches_keys);

namespace detail {
[[noreturn]] void no_json(const std::filesystem::path& path, std::size_t byte,
                          std::string_view remedy);
[[noreturn]] void no_number(const std::filesystem::path& path, std::string_view remedy);
[[noreturn]] void other_form(const std::filesystem::path& path, const char* what,
                             std::string_view remedy);
}  // namespace detail

/// The value of a text that stands in the file `path`.
template <class J = Json>
J parse_json(const std::filesystem::path& path, std::string_view text, std::string_view remedy) {
  measure_json(path, text, remedy, std::is_same_v<J, Json>);
  try {
    return J::parse(text.begin(), text.end());
  } catch (const typename J::parse_error& error) {
    detail::no_json(path, error.byte, remedy);
  } catch (const typename J::exception&) {
    detail::no_number(path, remedy);
  }
}

/// The bytes of a JSON file of at most kLargestJson bytes.
std::string read_json_text(const std::filesystem::path& path);

/// The value in a file.
template <class J = Json>
J read_json_as(const std::filesystem::path& path, std::string_view remedy) {
  return parse_json<J>(path, read_json_text(path), remedy);
}

/// The object in a file of a run or an experiment.
Json read_json(const std::filesystem::path& path);

/// Calls take(), which takes values out of what `path` held, and returns its result. A value that is
/// missing or of another type becomes an Error.
template <class Take>
auto take_from_json(const std::filesystem::path& path, std::string_view remedy, Take&& take) {
  try {
    return take();
  } catch (const SortedJson::exception& error) {
    detail::other_form(path, error.what(), remedy);
  }
}

/// A whole number, for take_from_json(): what becomes of a fraction or of 1e70 is not defined.
template <class T, class J>
T whole_number(const J& value) {
  if (!value.is_number_integer())
    throw J::type_error::create(302, "a whole number is expected", &value);
  return value.template get<T>();
}

}  // namespace gs
