// SPDX-License-Identifier: Apache-2.0
// Videos: what their headers promise, and which frames are taken. The first bytes choose how many
// frames are wanted, how many the video is said to have (0: what its header says), and its ending;
// the rest is the file.
// FFmpeg is not instrumented: what is tested is that we end where it gives nothing, less than was
// promised, or another size.
#include "data_loaders/video/sharpest_frames.h"
#include "data_loaders/video/video_frames.h"

#include "data_loaders/photos/photos.h"
#include "data_loaders/video/film_frames.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/foreign_leaks.h"

namespace gs::fuzz {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kHead = 3;  // bytes before the file
constexpr const char* kEndings[] = {"avi", "mp4", "mkv", "mpg"};

void take(const fs::path& video, std::int64_t total, std::int64_t wanted) {
  const fs::path frames = folder() / "frames";
  fs::create_directories(frames);
  std::int64_t read = 0;
  takes([&] {
    const std::vector<std::string> names =
        take_frames(video, total, wanted, frames, "a", [&](std::int64_t done) { read = done; });
    require(!names.empty() && std::int64_t(names.size()) <= std::max(read, wanted),
            "another number of frames was taken");
    for (const std::string& name : names) {
      require(read_photo_size(frames / name).width > 0, "a frame that was taken is no picture");
      const std::int64_t number = std::stoll(name.substr(2));
      require(number >= 0 && number < read, "a frame was taken that the video does not have");
    }
  });
  fs::remove_all(frames);
}

void read(std::string_view bytes) {
  if (bytes.size() <= kHead || !can_read_videos()) return;
  const auto head = [&](std::size_t i) { return std::int64_t(std::uint8_t(bytes[i])); };
  const IgnoreForeignLeaks video_library;
  const fs::path video =
      file_of(std::string("video.") + kEndings[head(2) % 4], bytes.substr(kHead));
  require(is_video(video), "an ending is not known");
  std::int64_t stated = 0;
  takes([&] { stated = count_frames(video); });
  require(stated >= 0, "a video has a negative number of frames");
  takes([&] { read_frame(video, head(0) % 8); });
  const bool is_believed = stated > 0 && head(1) == 0;
  take(video, is_believed ? stated : 1 + head(1), 1 + head(0) % 8);
}

const Registered registered{"videos", read};

}  // namespace
}  // namespace gs::fuzz
