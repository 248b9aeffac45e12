// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/video/film_frames.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <map>
#include <memory>
#include <string_view>

#include "data_loaders/photos/photo_names.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail_ended_early(const fs::path& video, std::int64_t frames) {
  throw Error(
      fmt::format("video {} ends after {} frames, but its header says that there are more: it is "
                  "damaged or cut short; copy it again, or write what it has into a new file with "
                  "ffmpeg -i VIDEO -c:v libx264 -crf 16 NEW.mp4",
                  video.string(), frames));
}

/// The frames of one video, in its order.
using Film = std::vector<std::size_t>;

std::vector<Film> films_of(const std::vector<VideoFrame>& frames) {
  std::map<fs::path, Film> of_videos;
  for (std::size_t i = 0; i < frames.size(); ++i) of_videos[frames[i].video].push_back(i);
  std::vector<Film> films;
  for (auto& [video, film] : of_videos) {
    std::ranges::sort(film, {}, [&](std::size_t i) { return frames[i].number; });
    films.push_back(std::move(film));
  }
  return films;
}

}  // namespace

bool is_video(const fs::path& file) {
  constexpr std::array<std::string_view, 10> kEndings = {".mp4",  ".mov", ".m4v",  ".avi", ".mkv",
                                                         ".webm", ".mpg", ".mpeg", ".mts", ".3gp"};
  return std::find(kEndings.begin(), kEndings.end(), lowercase_ending(file)) != kEndings.end();
}

Image8 read_frame(const fs::path& video, std::int64_t number) {
  const std::unique_ptr<VideoReader> reader = open_video(video);
  for (std::int64_t i = 0; i <= number; ++i)
    if (!reader->next()) fail_ended_early(video, i);
  return reader->picture();
}

void for_each_frame(const std::vector<VideoFrame>& frames, std::size_t most_at_once,
                    const std::function<bool(std::size_t i)>& wants,
                    const std::function<void(std::size_t i, Image8 picture)>& take) {
  GS_CHECK(most_at_once > 0);
  const std::vector<Film> films = films_of(frames);
  std::atomic<std::size_t> next = 0;
  std::atomic<bool> has_failed = false;  // then the other videos need not be decoded
  const auto decode = [&](Film film) {
    std::erase_if(film, [&](std::size_t i) { return !wants(i); });
    if (film.empty()) return;
    const fs::path& video = frames[film[0]].video;
    const std::unique_ptr<VideoReader> reader = open_video(video);
    std::int64_t read = 0;
    for (const std::size_t i : film) {
      for (; read <= frames[i].number; ++read) {
        if (has_failed) return;
        if (!reader->next()) fail_ended_early(video, read);
      }
      take(i, reader->picture());
    }
  };
  parallel_for(std::min(most_at_once, films.size()), 1, [&](std::size_t) {
    try {
      for (std::size_t film = next++; film < films.size() && !has_failed; film = next++)
        decode(films[film]);
    } catch (...) {
      has_failed = true;
      throw;
    }
  });
}

}  // namespace gs
