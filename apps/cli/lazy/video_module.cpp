// SPDX-License-Identifier: Apache-2.0
// gemsplat_video.so: OpenCV's videoio and the functions around it; modules.h says why.
#include "apps/cli/lazy/modules.h"

extern "C" __attribute__((visibility("default")))
const gs::VideoModule gs_video_module = {gs::detail::set_log_sink, gs::video_codec_name,
                                         gs::open_video, gs::count_frames, gs::make_film_encoder};
