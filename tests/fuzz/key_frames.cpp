// SPDX-License-Identifier: Apache-2.0
// Camera paths that the viewer has saved (`render --path FILE`), and the frames between their keys.
#include "gs_app/export/key_frames.h"

#include "gs_app/export/film_path.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

constexpr std::size_t kFrames = 7;

void require_finite(const Camera& camera, const char* what) {
  const bool is_lens = std::isfinite(camera.fx) && std::isfinite(camera.fy) && camera.fx > 0 &&
                       camera.fy > 0 && camera.width > 0 && camera.height > 0;
  require(is_lens && is_finite(camera.position()), what);
}

void read(std::string_view bytes) {
  const std::filesystem::path file = file_of("path.json", bytes);
  takes([&] {
    const KeyFrames frames = read_key_frames(file, Vec3d(1e3, 0.0, -1e3));
    for (const NamedCamera& key : frames.keys) require_finite(key.camera, "a key stands nowhere");
    PathRequest request;
    request.kind = kKeyFrames;
    request.frames = kFrames;
    request.pace = frames.pace;
    request.is_loop = frames.is_closed;
    const FilmPath path = film_path(request, frames.keys, {}, {});
    require(path.cameras.size() == kFrames, "a path has another number of frames");
    for (const NamedCamera& frame : path.cameras)
      require_finite(frame.camera, "a frame of a path stands nowhere");
  });
}

const Registered registered{"key_frames", read};

}  // namespace
}  // namespace gs::fuzz
