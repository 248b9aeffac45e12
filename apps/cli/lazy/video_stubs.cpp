// SPDX-License-Identifier: Apache-2.0
// Videos, by way of gemsplat_video.so; modules.h says why.
#include "apps/cli/lazy/modules.h"

namespace gs {
namespace {

const VideoModule& module() {
  static const VideoModule& table =
      loaded_module<VideoModule>("gemsplat_video.so", "gs_video_module");
  return table;
}

}  // namespace

bool can_read_videos() { return true; }
std::string video_codec_name() { return module().video_codec_name(); }
std::unique_ptr<VideoReader> open_video(const std::filesystem::path& video) {
  return module().open_video(video);
}
std::int64_t count_frames(const std::filesystem::path& video) {
  return module().count_frames(video);
}
std::unique_ptr<FilmEncoder> make_film_encoder() { return module().make_film_encoder(); }

}  // namespace gs
