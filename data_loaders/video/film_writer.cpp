// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/video/film_writer.h"

#include <spdlog/fmt/fmt.h>

#include "data_loaders/video/film_encoder.h"
#include "data_loaders/video/panorama_film.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/log.h"

namespace gs {

namespace fs = std::filesystem;

#ifdef GS_HAVE_VIDEO

namespace {

[[noreturn]] void cannot_write_film(const fs::path& film, const std::string& what) {
  throw Error(fmt::format("cannot write the film {}: {}", film.string(), what));
}

}  // namespace

bool can_write_films() { return true; }
std::string cannot_write_films() { return {}; }

FilmWriter::FilmWriter(fs::path path, int width, int height, double frames_per_second)
    : path_(std::move(path)), width_(width), height_(height), encoder_(make_film_encoder()) {
  GS_CHECK(width > 0 && height > 0 && width % 2 == 0 && height % 2 == 0 && frames_per_second > 0);
  { const AtomicFile is_writable(path_); }  // makes the folder; says why where it is not
  // An absolute path, because ffmpeg would take "a:b.mp4" for a protocol.
  temporary_ = make_temporary_beside(fs::absolute(path_), ".mp4");
  const auto opens = [&](const char* four_letters) {
    return encoder_->open(temporary_, four_letters, width_, height_, frames_per_second);
  };
  codec_ = "H.264";
  if (opens("avc1")) return;
  codec_ = "MPEG-4";
  if (!opens("mp4v")) {
    std::error_code ignored;
    fs::remove(temporary_, ignored);
    cannot_write_film(
        path_,
        "OpenCV cannot begin an MP4 here; free some space, or install libopencv-videoio "
        "with ffmpeg's libavcodec, or write pictures into a folder");
  }
  log_warning(
      "{} is encoded as MPEG-4 Part 2, which browsers do not play: the local ffmpeg has no H.264; "
      "convert it with `ffmpeg -i FILM -c:v libx264 -pix_fmt yuv420p NEW.mp4` elsewhere",
      path_.string());
}

FilmWriter::FilmWriter(FilmWriter&&) noexcept = default;

FilmWriter::~FilmWriter() {
  if (!encoder_) return;  // committed, or moved from
  encoder_->close();
  std::error_code ignored;
  fs::remove(temporary_, ignored);
}

void FilmWriter::write(const Image8& frame) {
  GS_CHECK(encoder_ && frame.width == width_ && frame.height == height_ &&
           (frame.channels == 1 || frame.channels == 3));
  encoder_->write(frame);
  ++frames_;
}

void FilmWriter::commit(bool is_panorama) {
  encoder_->close();
  // The encoder does not say where it fails: a film that lacks frames tells.
  std::int64_t kept = 0;
  try {
    kept = count_frames(temporary_);
  } catch (const Error&) {
  }
  if (kept != frames_)
    cannot_write_film(path_, fmt::format("{} of {} frames reached the disk; free some space, or "
                                         "write elsewhere",
                                         kept, frames_));
  if (is_panorama && !mark_as_panorama(temporary_))
    log_warning("{} does not say that it is a panorama: this OpenCV writes MP4 in another order",
                path_.string());
  std::error_code error;
  fs::rename(temporary_, path_, error);
  if (error) cannot_write_film(path_, error.message() + "; choose another name");
  encoder_.reset();
}

#else

bool can_write_films() { return false; }
std::string cannot_write_films() {
  return "this build has no OpenCV with videoio; write pictures into a folder and make the film "
         "with ffmpeg -framerate 30 -i FOLDER/%05d.png -c:v libx264 -pix_fmt yuv420p FILM.mp4, or "
         "install libopencv-dev and build again";
}

FilmWriter::FilmWriter(fs::path path, int, int, double) {
  throw Error(fmt::format("cannot write the film {}: {}", path.string(), cannot_write_films()));
}
FilmWriter::FilmWriter(FilmWriter&&) noexcept = default;
FilmWriter::~FilmWriter() = default;
void FilmWriter::write(const Image8&) {}
void FilmWriter::commit(bool) {}

#endif

}  // namespace gs
