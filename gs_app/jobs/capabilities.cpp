// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/capabilities.h"

#include <spdlog/fmt/fmt.h>

#include "data_loaders/video/film_writer.h"
#include "gs_app/report/report_page.h"
#include "gs_app/view/view_server.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

Capability cuda_capability() {
  const int count = cuda_device_count();
  if (count > 0)
    return {"CUDA", true, "trains and renders on " + std::to_string(count) + " GPU(s)"};
  return {"CUDA", false, (has_cuda() ? "this build has CUDA, but " : "") + why_no_gpu()};
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
  return {"OpenCV", true, "undistorts photos quickly, measures LPIPS"};
#else
  return {"OpenCV", false,
          "measures no LPIPS, and undistorts photos by slower code of its own; install "
          "libopencv-dev and build again"};
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

Capability python_capability() {
#ifdef GS_HAVE_PYTHON
  return {"Python", true, "scripts/setup.sh builds the module gemsplat (docs/reference/python.md)"};
#else
  return {"Python", false,
          "there is no Python module; install pybind11-dev, python3-dev and python3-numpy, and "
          "build again"};
#endif
}

Capability viewer_capability() {
  return {"viewer", can_view(),
          can_view() ? "serves models and runs to a browser (`gemsplat view`, `train --viewer`)"
                     : cannot_view()};
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

std::vector<Capability> capabilities() {
  return {{"CPU", true, "trains and renders on " + std::to_string(thread_count()) + " threads"},
          cuda_capability(),
          openimageio_capability(),
          opencv_capability(),
          film_capability(),
          ceres_capability(),
          report_capability(),
          viewer_capability(),
          format_capability(kHasZlib, "zlib", ".spz", "zlib1g-dev"),
          format_capability(kHasZstd, "zstd", ".spz of version 4", "libzstd-dev"),
          format_capability(kHasWebp, "libwebp", ".sog", "libwebp-dev"),
          python_capability()};
}

}  // namespace gs
