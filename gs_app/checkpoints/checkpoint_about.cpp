// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checkpoints/checkpoint_about.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <cmath>

#include "gs_core/config/config_limits.h"
#include "gs_core/error.h"
#include "gs_core/system/files/checked_file.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"
#include "gs_core/system/version.h"

namespace gs {
namespace {

// The hashes of the views' photos: 16 hexadecimal digits each.
constexpr std::size_t kHashDigits = 16;

std::string photo_text(const std::vector<ViewRecord>& views) {
  std::string text;
  for (const ViewRecord& view : views) text += fmt::format("{:016x}", view.photo);
  return text;
}

void take_photos_of(const std::string& text, std::vector<ViewRecord>& views) {
  if (text.size() != views.size() * kHashDigits) return;  // a checkpoint of version 0.1.0 has none
  for (std::size_t i = 0; i < views.size(); ++i) {
    const char* const first = text.data() + i * kHashDigits;
    std::from_chars(first, first + kHashDigits, views[i].photo, 16);
  }
}

/// Reads the numbers, each of which has a range.
class Numbers {
 public:
  Numbers(const std::filesystem::path& path, const std::string& text)
      : path_(path), json_(parse_json(path, text, kRemedy)) {
    if (!json_.is_object()) refuse("its section \"about\" is no object");
  }
  std::int64_t whole(const char* key, std::int64_t most) const {
    const auto value = json_.find(key);
    const bool fits = value != json_.end() && value->is_number_unsigned() &&
                      value->get<std::uint64_t>() <= std::uint64_t(most);
    if (!fits) refuse(fmt::format("{} is no whole number from 0 to {}", key, most));
    return value->get<std::int64_t>();
  }
  /// A count; 0 where a checkpoint of an older version has none.
  std::int64_t whole_or_0(const char* key) const {
    return json_.contains(key) ? whole(key, std::int64_t(limits::kLargestExact)) : 0;
  }
  double number(const char* key, double low, double high) const {
    return inside(json_.value(key, Json()), key, low, high);
  }
  /// A text; empty where a checkpoint of an older version has none.
  std::string text(const char* key) const {
    const Json value = json_.value(key, Json(""));
    if (!value.is_string()) refuse(fmt::format("{} is no text", key));
    return value.get<std::string>();
  }
  Vec3d vector(const char* key) const {
    const Json list = json_.value(key, Json());
    if (!list.is_array() || list.size() != 3) refuse(fmt::format("{} is no vector", key));
    Vec3d vector;
    for (std::size_t k = 0; k < 3; ++k)
      vector[int(k)] = inside(list[k], key, -limits::kLargestExact, limits::kLargestExact);
    return vector;
  }

 private:
  double inside(const Json& value, const char* key, double low, double high) const {
    const double number = value.is_number() ? value.get<double>() : NAN;
    if (!(number >= low && number <= high))
      refuse(fmt::format("{} is no number from {:.3g} to {:.3g}", key, low, high));
    return number;
  }
  [[noreturn]] void refuse(const std::string& what) const {
    cannot_read(path_, fmt::format("{}; {}", what, kRemedy));
  }

  static constexpr const char* kRemedy = "it is of another version or forged, resume another one";
  const std::filesystem::path& path_;
  Json json_;
};

}  // namespace

std::string about_text(const RunProgress& progress, const TrainingModel& model,
                       const SceneRecord& scene) {
  return Json{{"gemsplat", kVersion},
              {"step", progress.step},
              {"gaussians", model.count()},
              {"adam_steps", model.adam_steps},
              {"first_gaussians", model.first_count},
              {"sh_degree", progress.sh_degree},
              {"loss", progress.loss},
              {"train_seconds", progress.train_seconds},
              {"growth_cap", progress.growth_cap},
              {"extent", scene.extent},
              {"world_offset", {scene.world_offset.x, scene.world_offset.y, scene.world_offset.z}},
              {"photos", photo_text(scene.views)}}
      .dump();
}

void take_about(const std::filesystem::path& path, const std::string& text,
                Checkpoint& checkpoint) {
  const Numbers numbers(path, text);
  constexpr double kLargest = limits::kLargestFloat;
  RunProgress& progress = checkpoint.state.progress;
  progress.step = int(numbers.whole("step", kMostSteps));
  progress.sh_degree = int(numbers.whole("sh_degree", kMaxShDegree));
  progress.loss = numbers.number("loss", -kLargest, kLargest);
  progress.train_seconds = numbers.number("train_seconds", 0, kLargest);
  progress.growth_cap = numbers.whole("growth_cap", std::int64_t(limits::kLargestExact));
  checkpoint.state.model.adam_steps = int(numbers.whole("adam_steps", kMostSteps));
  checkpoint.state.model.first_count = std::size_t(numbers.whole_or_0("first_gaussians"));
  checkpoint.scene.extent = float(numbers.number("extent", 0, kLargest));
  checkpoint.scene.world_offset = numbers.vector("world_offset");
  take_photos_of(numbers.text("photos"), checkpoint.scene.views);
}

}  // namespace gs
