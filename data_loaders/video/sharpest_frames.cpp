// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/video/sharpest_frames.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/picture_quality.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

constexpr double kEndedEarly = 0.9;  // of the frames in the header, which may be off by a few

// The present frame; none where it cannot be decoded, which is the end of a damaged video.
std::optional<Image8> decoded(VideoReader& reader) {
  try {
    return reader.picture();
  } catch (const Error&) {
    return std::nullopt;
  }
}

struct SharpFrame {
  std::int64_t number = -1;
  Image8 picture;
  double sharpness = -1;
};

}  // namespace

std::vector<std::string> take_frames(const std::filesystem::path& video, std::int64_t total,
                                     std::int64_t wanted, const std::filesystem::path& folder,
                                     const std::string& stem, const FrameProgress& progress) {
  GS_CHECK(total > 0 && wanted > 0);
  wanted = std::min(wanted, total);
  const std::unique_ptr<VideoReader> reader = open_video(video);
  std::vector<std::string> names;
  SharpFrame best;
  const auto keep_best = [&] {
    if (best.number < 0) return;
    names.push_back(fmt::format("{}_{:06d}.png", stem, best.number));
    write_png(folder / names.back(), best.picture);
    best = {};
  };
  const auto stretch_of = [&](std::int64_t number) { return number * wanted / total; };
  std::int64_t number = 0;
  for (; reader->next(); ++number) {
    std::optional<Image8> picture = decoded(*reader);
    if (!picture) break;
    if (number > 0 && stretch_of(number) != stretch_of(number - 1)) keep_best();
    const double sharpness = quality_of(*picture).sharpness;
    if (sharpness > best.sharpness) best = {number, std::move(*picture), sharpness};
    if (progress) progress(number + 1);
  }
  keep_best();
  if (number == 0) cannot_read_video(video, "it has no frame that can be decoded");
  if (double(number) < kEndedEarly * double(total))
    log_warning(
        "video {} ends after {} of {} frames: it is damaged or cut short; the frames before are "
        "used",
        video.string(), number, total);
  return names;
}

}  // namespace gs
