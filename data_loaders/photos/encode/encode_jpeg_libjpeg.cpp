// SPDX-License-Identifier: Apache-2.0
// JPEGs by libjpeg (libjpeg-turbo takes a seventh of stb_image_write's time), for machines without
// OpenImageIO, which calls libjpeg itself.
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <string>

#include <jpeglib.h>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "gs_core/error.h"

namespace gs {
namespace {

// libjpeg ends the program on an error unless it may jump out of the call. No object with a
// destructor lies on the way.
class JpegEncoder {
 public:
  ~JpegEncoder() {
    jpeg_destroy_compress(&state_);
    std::free(bytes_);
  }

  /// False if libjpeg refuses the picture; complaint() says why.
  bool encode(const Image8& image, int quality) {
    state_.err = jpeg_std_error(&errors_);
    state_.client_data = this;
    errors_.error_exit = [](j_common_ptr state) {
      auto* const encoder = static_cast<JpegEncoder*>(state->client_data);
      state->err->format_message(state, encoder->complaint_);
      std::longjmp(encoder->failed_, 1);
    };
    if (setjmp(failed_) != 0) return false;
    jpeg_create_compress(&state_);
    jpeg_mem_dest(&state_, &bytes_, &size_);
    start(image, quality);
    write_rows(image);
    jpeg_finish_compress(&state_);
    return true;
  }
  std::vector<std::uint8_t> bytes() const { return {bytes_, bytes_ + size_}; }
  std::string complaint() const { return complaint_; }

 private:
  void start(const Image8& image, int quality) {
    state_.image_width = JDIMENSION(image.width);
    state_.image_height = JDIMENSION(image.height);
    state_.input_components = 3;
    state_.in_color_space = JCS_RGB;
    jpeg_set_defaults(&state_);
    jpeg_set_quality(&state_, quality, TRUE);
    jpeg_start_compress(&state_, TRUE);
  }
  void write_rows(const Image8& image) {
    const std::size_t stride = 3 * std::size_t(image.width);
    while (state_.next_scanline < state_.image_height) {
      // libjpeg takes pointers to what it does not change
      auto* row = const_cast<JSAMPROW>(image.pixels.data() + stride * state_.next_scanline);
      jpeg_write_scanlines(&state_, &row, 1);
    }
  }

  jpeg_compress_struct state_ = {};
  jpeg_error_mgr errors_ = {};
  std::jmp_buf failed_ = {};
  char complaint_[JMSG_LENGTH_MAX] = "";
  unsigned char* bytes_ = nullptr;
  unsigned long size_ = 0;
};

}  // namespace

std::vector<std::uint8_t> encode_jpeg_alone(const Image8& image, int quality) {
  GS_CHECK(image.channels == 3);
  JpegEncoder encoder;
  if (!encoder.encode(image, quality))
    throw Error("cannot encode a JPEG of " + std::to_string(image.width) + " x " +
                std::to_string(image.height) + " pixels: " + encoder.complaint() +
                "; write smaller pictures");
  return encoder.bytes();
}

}  // namespace gs
