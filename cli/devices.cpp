// SPDX-License-Identifier: Apache-2.0
#include "cli/devices.h"

#include <spdlog/fmt/fmt.h>

#include "cli/report_page.h"
#include "data_loaders/film_writer.h"
#include "gs_core/error.h"
#include "gs_core/parallel.h"

#ifdef GS_HAVE_CUDA
#include "cuda/backend.h"
#endif

namespace gs {
namespace {

#ifdef GS_HAVE_CUDA
int cuda_devices() { return cuda::device_count(); }

std::unique_ptr<Backend> make_cuda_backend(int index) {
  if (index < cuda_devices()) return cuda::make_backend(index);
  throw Error("there is no GPU cuda:" + std::to_string(index) + ": the driver reports " +
              std::to_string(cuda_devices()) + "; check nvidia-smi, or use --device cpu");
}
#else
int cuda_devices() { return 0; }

std::unique_ptr<Backend> make_cuda_backend(int) {
  throw Error(
      "this build has no CUDA; configure again where nvcc is on the PATH (-DGS_REQUIRE_CUDA=ON "
      "says what "
      "is missing), or use --device cpu");
}
#endif

Capability cuda_capability() {
#ifdef GS_HAVE_CUDA
  const int count = cuda_devices();
  return {"CUDA", count > 0,
          count > 0 ? "trains and renders on " + std::to_string(count) + " GPU(s)"
                    : "this build has CUDA, and the driver reports no GPU; check nvidia-smi"};
#else
  return {"CUDA", false,
          "training and rendering run on the CPU; build again where nvcc is on the PATH"};
#endif
}

Capability openimageio_capability() {
#ifdef GS_HAVE_OPENIMAGEIO
  return {"OpenImageIO", true, "reads every common picture format, writes EXR"};
#else
  return {"OpenImageIO", false,
          "reads JPEG and PNG only, writes no EXR; install libopenimageio-dev and build again"};
#endif
}

Capability opencv_capability() {
#ifdef GS_HAVE_OPENCV
  return {"OpenCV", true, "undistorts photos of radial, tangential and fisheye lens models"};
#else
  return {
      "OpenCV", false,
      "takes undistorted photos only (PINHOLE, SIMPLE_PINHOLE); run `colmap image_undistorter`, or "
      "install libopencv-dev and build again"};
#endif
}

Capability film_capability() {
  return {"films", can_write_films(),
          can_write_films()
              ? "takes frames out of videos, writes films (.mp4)"
              : "neither takes frames out of videos nor writes films: " + cannot_write_films()};
}

Capability ceres_capability() {
#ifdef GS_HAVE_CERES
  return {"Ceres", true, "refines cameras and solves for exposures (--refine-cameras, --exposure)"};
#else
  return {"Ceres", false,
          "neither refines cameras nor solves for exposures; install libceres-dev and build again"};
#endif
}

Capability report_capability() {
  return {
      "reports", can_write_reports(),
      can_write_reports() ? "writes report.html of runs and experiments" : cannot_write_reports()};
}

// What a build without a library cannot read or write.
Capability format_capability(bool is_there, const char* name, const char* files,
                             const char* package) {
  return {name, is_there,
          is_there ? fmt::format("reads and writes {}", files)
                   : fmt::format("neither reads nor writes {}; install {} and build again", files,
                                 package)};
}

#ifdef GS_HAVE_ZLIB
constexpr bool kHasZlib = true;
#else
constexpr bool kHasZlib = false;
#endif
#ifdef GS_HAVE_ZSTD
constexpr bool kHasZstd = true;
#else
constexpr bool kHasZstd = false;
#endif
#ifdef GS_HAVE_WEBP
constexpr bool kHasWebp = true;
#else
constexpr bool kHasWebp = false;
#endif

}  // namespace

std::unique_ptr<Backend> make_backend(const std::string& device) {
  if (device == "cpu") return make_scalar_backend();
  if (device == "auto") return cuda_devices() > 0 ? make_cuda_backend(0) : make_scalar_backend();
  const std::size_t colon = device.find(':');
  try {
    return make_cuda_backend(colon == device.npos ? 0 : std::stoi(device.substr(colon + 1)));
  } catch (const std::out_of_range&) {
    throw UsageError("--device " + device + ": there is no GPU with such a number");
  }
}

std::vector<Capability> capabilities() {
  return {{"CPU", true, "trains and renders on " + std::to_string(thread_count()) + " threads"},
          cuda_capability(),
          openimageio_capability(),
          opencv_capability(),
          film_capability(),
          ceres_capability(),
          report_capability(),
          format_capability(kHasZlib, "zlib", ".spz", "zlib1g-dev"),
          format_capability(kHasZstd, "zstd", ".spz of version 4", "libzstd-dev"),
          format_capability(kHasWebp, "libwebp", ".sog", "libwebp-dev")};
}

}  // namespace gs
