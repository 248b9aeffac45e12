// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/key_frames.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

constexpr const char* kFormat = "gemsplat key frames";
constexpr int kVersion = 1;
constexpr double kLongest = 86'400;  // seconds; more is a mistake
constexpr const char* kRemedyOfKeyFrames = "save the path in the viewer again";

[[noreturn]] void fail(const std::filesystem::path& file, const std::string& what) {
  cannot_read(file, fmt::format("{}; {}", what, kRemedyOfKeyFrames));
}

void check_format(const std::filesystem::path& file, const SortedJson& json) {
  if (!json.is_object() || json.value("format", SortedJson()) != kFormat)
    fail(file, fmt::format("it is no file of \"{}\"", kFormat));
  const SortedJson version = json.value("version", SortedJson());
  if (version.is_number_integer() && version > kVersion)
    cannot_read(file, fmt::format("its version is {}, and this program reads {}; update gemsplat",
                                  version.dump(), kVersion));
  if (version != kVersion) fail(file, "it has no version");
}

double seconds_of(const std::filesystem::path& file, const SortedJson& json) {
  const SortedJson value = json.value("seconds", SortedJson());
  const double seconds = value.is_number() ? value.get<double>() : 0;
  if (!(seconds > 0 && seconds <= kLongest)) fail(file, "its seconds are not a number above 0");
  return seconds;
}

}  // namespace

KeyFrames read_key_frames(const std::filesystem::path& file, const Vec3d& world_offset) {
  const SortedJson json = read_json_as<SortedJson>(file, kRemedyOfKeyFrames);
  check_format(file, json);
  KeyFrames frames;
  frames.seconds = seconds_of(file, json);
  const SortedJson closed = json.value("closed", SortedJson(false)),
                   pace = json.value("pace", SortedJson("even"));
  if (!closed.is_boolean()) fail(file, "closed is neither true nor false");
  if (pace != "even" && pace != "keys") fail(file, "its pace is neither even nor keys");
  frames.is_closed = closed.get<bool>();
  frames.pace = pace.get<std::string>();
  const SortedJson keys = json.value("keys", SortedJson());
  if (!keys.is_array() || keys.size() < 2) fail(file, "it has fewer than two keys");
  frames.keys = cameras_of_json(keys, file, world_offset);
  return frames;
}

}  // namespace gs
