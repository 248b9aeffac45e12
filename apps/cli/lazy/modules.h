// SPDX-License-Identifier: Apache-2.0
// The two libraries that take long to load, OpenImageIO (340 ms, 273 shared objects) and OpenCV's
// videoio (220 ms), are no part of the program. They are linked into modules beside it, which are
// loaded at the first photo or video. `gemsplat --version` then takes some 30 ms.
//
// How it works: photos_stubs.cpp and video_stubs.cpp define the functions of
// data_loaders/photos/photo_codec.h and so on in the program. Since the linker has a definition, it
// leaves out the ones of data_loaders, and with them the libraries. Each stub calls the same
// function in the module, through the table of pointers below.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/video/film_encoder.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/system/log.h"

namespace gs {

/// The module gemsplat_photos.so, in the order of its functions in photo_codec.h,
/// encode_jpeg.h and exr.h.
struct PhotoModule {
  void (*set_log_sink)(void (*)(detail::LogLevel, std::string_view));
  Image8 (*decode_photo)(const std::filesystem::path&);
  MapFile (*decode_map)(const MapKind&, const std::filesystem::path&);
  PhotoSize (*decode_photo_size)(const std::filesystem::path&);
  int (*decode_photo_orientation)(const std::filesystem::path&);
  std::optional<Geodetic> (*decode_photo_place)(const std::filesystem::path&);
  ExposureTags (*decode_exposure_tags)(const std::filesystem::path&);
  std::string (*codec_name)();
  std::vector<std::uint8_t> (*encode_jpeg_alone)(const Image8&, int quality);
  std::vector<std::uint8_t> (*encode_jpeg_copy)(const std::filesystem::path&, const Image8&);
  void (*write_exr)(const std::filesystem::path&, const ImageF&, const std::vector<std::string>&);
  ImageF (*read_exr)(const std::filesystem::path&, std::vector<std::string>*);
};

/// The module gemsplat_video.so: video_frames.h and film_encoder.h.
struct VideoModule {
  void (*set_log_sink)(void (*)(detail::LogLevel, std::string_view));
  std::string (*video_codec_name)();
  std::unique_ptr<VideoReader> (*open_video)(const std::filesystem::path&);
  std::int64_t (*count_frames)(const std::filesystem::path&);
  std::unique_ptr<FilmEncoder> (*make_film_encoder)();
};

/// The table named `symbol` in the module `file` ("gemsplat_photos.so"), which lies in lib/gemsplat
/// beside the program's folder bin. Throws Error where it is missing.
const void* load_module(const std::string& file, const std::string& symbol);

/// The same as a table of this type, whose module writes its log lines through the program.
template <class Table>
const Table& loaded_module(const std::string& file, const std::string& symbol) {
  const auto* table = static_cast<const Table*>(load_module(file, symbol));
  table->set_log_sink(detail::log_line);
  return *table;
}

}  // namespace gs
