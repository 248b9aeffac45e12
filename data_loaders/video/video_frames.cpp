// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/video/video_frames.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/math/constants.h"

#ifdef GS_HAVE_VIDEO
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <opencv2/videoio/registry.hpp>
#endif

namespace gs {

namespace fs = std::filesystem;

#ifdef GS_HAVE_VIDEO

namespace {

/// FFmpeg alone, where OpenCV has it. Its other readers take the name for a row of pictures, which
/// they decode without our limits, for a pipeline, or for a camera, whose drivers they load.
int reader_of_videos() {
  const std::vector<cv::VideoCaptureAPIs> known = cv::videoio_registry::getStreamBackends();
  return std::ranges::find(known, cv::CAP_FFMPEG) != known.end() ? cv::CAP_FFMPEG : cv::CAP_ANY;
}

constexpr double kMostFramePixels = 8192.0 * 4320;  // of the largest cameras; FFmpeg holds several

/// Before anything is made of frames of a size that no camera takes.
void check_size(const fs::path& video, double width, double height) {
  if (width <= kMaxPictureSide && height <= kMaxPictureSide && width * height <= kMostFramePixels)
    return;
  cannot_read_video(video,
                    fmt::format("its frames have {:.0f}x{:.0f} pixels, and videos are read up "
                                "to 8192x4320; take frames with ffmpeg and train on these",
                                width, height));
}

cv::VideoCapture open_capture(const fs::path& video) {
  std::error_code error;
  if (!fs::is_regular_file(video, error)) cannot_read_video(video, "there is no such file");
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);  // we say it ourselves
  cv::VideoCapture capture;
  if (!capture.open(video.string(), reader_of_videos()))
    cannot_read_video(video, "it is damaged, or has a format that OpenCV does not know");
  check_size(video, capture.get(cv::CAP_PROP_FRAME_WIDTH), capture.get(cv::CAP_PROP_FRAME_HEIGHT));
  capture.set(cv::CAP_PROP_ORIENTATION_AUTO, 1);
  return capture;
}

Image8 picture_of(const cv::Mat& frame) {
  Image8 picture(frame.cols, frame.rows, 3);
  cv::Mat rgb(frame.rows, frame.cols, CV_8UC3, picture.pixels.data());
  cv::cvtColor(frame, rgb, frame.channels() == 1 ? cv::COLOR_GRAY2RGB : cv::COLOR_BGR2RGB);
  GS_CHECK(rgb.data == picture.pixels.data());
  return picture;
}

class OpenCvReader final : public VideoReader {
 public:
  explicit OpenCvReader(const fs::path& video) : video_(video), capture_(open_capture(video)) {}
  bool next() override { return capture_.grab(); }
  Image8 picture() override {
    cv::Mat frame;
    if (!capture_.retrieve(frame) || frame.empty())
      cannot_read_video(video_, "a frame cannot be decoded");
    check_size(video_, frame.cols, frame.rows);
    return picture_of(frame);
  }

 private:
  const fs::path video_;
  cv::VideoCapture capture_;
};

}  // namespace

bool can_read_videos() { return true; }
std::string video_codec_name() { return "OpenCV " CV_VERSION; }

std::unique_ptr<VideoReader> open_video(const fs::path& video) {
  return std::make_unique<OpenCvReader>(video);
}

std::int64_t count_frames(const fs::path& video) {
  cv::VideoCapture capture = open_capture(video);
  const double stated = capture.get(cv::CAP_PROP_FRAME_COUNT);
  if (stated >= 1 && stated < 1e9) return std::int64_t(stated);
  std::int64_t count = 0;
  while (capture.grab()) ++count;
  if (count == 0) cannot_read_video(video, "it has no frame that can be decoded");
  return count;
}

#else

namespace {

[[noreturn]] void fail_without_opencv(const fs::path& video) {
  throw Error(
      fmt::format("cannot read video {}: this build has no OpenCV with videoio; install it "
                  "(libopencv-dev in Debian and Ubuntu) and build again, or take frames out with "
                  "ffmpeg -i VIDEO -vf fps=2 -qscale:v 2 FRAMES/%05d.jpg and name FRAMES",
                  video.string()));
}

}  // namespace

bool can_read_videos() { return false; }
std::string video_codec_name() { return {}; }
std::unique_ptr<VideoReader> open_video(const fs::path& video) { fail_without_opencv(video); }
std::int64_t count_frames(const fs::path& video) { fail_without_opencv(video); }

#endif

}  // namespace gs
