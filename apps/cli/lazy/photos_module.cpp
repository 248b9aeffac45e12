// SPDX-License-Identifier: Apache-2.0
// gemsplat_photos.so: OpenImageIO and the functions around it; modules.h says why.
#include "apps/cli/lazy/modules.h"
#include "data_loaders/photos/exr.h"

extern "C" __attribute__((visibility("default")))
const gs::PhotoModule gs_photo_module = {gs::detail::set_log_sink,
                                         gs::decode_photo,
                                         gs::decode_map,
                                         gs::decode_photo_size,
                                         gs::decode_photo_orientation,
                                         gs::decode_photo_place,
                                         gs::decode_exposure_tags,
                                         gs::codec_name,
                                         gs::encode_jpeg_alone,
                                         gs::encode_jpeg_copy,
                                         gs::write_exr,
                                         gs::read_exr};
