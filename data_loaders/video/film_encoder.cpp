// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/video/film_encoder.h"

#ifdef GS_HAVE_VIDEO
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#endif

namespace gs {

#ifdef GS_HAVE_VIDEO

namespace {

class OpenCvFilmEncoder final : public FilmEncoder {
 public:
  bool open(const std::filesystem::path& film, const char* f, int width, int height,
            double frames_per_second) override {
    // FilmWriter reports errors itself.
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    writer_.open(film.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc(f[0], f[1], f[2], f[3]),
                 frames_per_second, cv::Size(width, height), true);
    return writer_.isOpened();
  }

  void write(const Image8& frame) override {
    const cv::Mat picture(frame.height, frame.width, frame.channels == 1 ? CV_8UC1 : CV_8UC3,
                          const_cast<std::uint8_t*>(frame.pixels.data()));
    cv::cvtColor(picture, bgr_, frame.channels == 1 ? cv::COLOR_GRAY2BGR : cv::COLOR_RGB2BGR);
    writer_.write(bgr_);
  }

  void close() override { writer_.release(); }

 private:
  cv::VideoWriter writer_;
  cv::Mat bgr_;
};

}  // namespace

std::unique_ptr<FilmEncoder> make_film_encoder() { return std::make_unique<OpenCvFilmEncoder>(); }

#else

std::unique_ptr<FilmEncoder> make_film_encoder() { return nullptr; }

#endif

}  // namespace gs
