// SPDX-License-Identifier: Apache-2.0

// This include comes first, because OpenImageIO's headers bring a second copy of fmt's library into
// files that have not included fmt.
#include <spdlog/fmt/fmt.h>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include "data_loaders/photos/exr.h"
#include "data_loaders/photos/photo_codec.h"
#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/atomic_file.h"

namespace gs {

bool can_write_exr() { return true; }
std::string cannot_write_exr() { return {}; }

void write_exr(const std::filesystem::path& path, const ImageF& image,
               const std::vector<std::string>& channels) {
  GS_CHECK(!image.empty() && std::size_t(image.channels) == channels.size());
  OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::FLOAT);
  spec.channelnames = channels;
  spec.attribute("compression", "zip");
  std::vector<unsigned char> bytes;
  OIIO::Filesystem::IOVecOutput sink(bytes);
  const auto output = OIIO::ImageOutput::create("exr", &sink);
  const bool done = output && output->open("picture.exr", spec) &&
                    output->write_image(OIIO::TypeDesc::FLOAT, image.pixels.data()) &&
                    output->close();
  if (!done)
    throw Error(
        fmt::format("cannot write {}: {}; write PNG (--format png), or reinstall OpenImageIO",
                    path.string(), output ? output->geterror() : OIIO::geterror()));
  AtomicFile file(path);
  file.write(bytes.data(), bytes.size());
  file.commit();
}

ImageF read_exr(const std::filesystem::path& path, std::vector<std::string>* channels) {
  const auto input = OIIO::ImageInput::open(path.string());
  if (!input) cannot_read(path, OIIO::geterror() + "; write it again");
  const OIIO::ImageSpec& spec = input->spec();
  if (spec.format != OIIO::TypeDesc::FLOAT)
    cannot_read(path, "it does not hold 32-bit floats; name an EXR that does");
  check_photo_size(path, {spec.width, spec.height});
  ImageF image(spec.width, spec.height, spec.nchannels);
  if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.pixels.data()))
    cannot_read(path, input->geterror() + "; write it again");
  if (channels) *channels = spec.channelnames;
  return image;
}

}  // namespace gs
