// SPDX-License-Identifier: Apache-2.0
// Photos through OpenImageIO: JPEG, PNG, TIFF, EXR, WebP and all else that the installed library
// knows.

// This include comes first, because OpenImageIO's headers bring a second copy of fmt's library into
// files that have not included fmt.
#include <spdlog/fmt/fmt.h>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/photos/picture_header.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

struct OpenPhoto {
  std::unique_ptr<OIIO::ImageInput> input;
  PhotoSize size;
};

OpenPhoto open_photo(const std::filesystem::path& path) {
  OIIO::ImageSpec wishes;
  wishes.attribute("oiio:reorient", 0);           // as COLMAP: stored order
  wishes.attribute("oiio:UnassociatedAlpha", 1);  // color not multiplied by alpha
  OpenPhoto photo;
  photo.input = OIIO::ImageInput::open(path.string(), &wishes);
  if (!photo.input) cannot_read_photo(path, OIIO::geterror());
  const OIIO::ImageSpec& spec = photo.input->spec();
  photo.size = {spec.width, spec.height};
  check_photo_size(path, photo.size);
  if (PictureHeader header = read_picture_header(path); header.width == 0) {  // we do not know it
    header.width = std::uint64_t(std::max(spec.width, spec.tile_width));
    header.height = std::uint64_t(std::max(spec.height, spec.tile_height));
    header.bytes_per_pixel = std::uint64_t(spec.pixel_bytes());
    check_picture(path, header);
  }
  return photo;
}

/// Whether libjpeg only met surplus bytes before the end marker, which some cameras write: all
/// pixels are decoded by then.
bool is_harmless(const std::string& complaint) {
  return complaint.find("extraneous bytes before marker 0xd9") != std::string::npos &&
         complaint.find('\n') == std::string::npos;
}

/// Channels to read: gray or color, and alpha where it follows them.
int channels_of(const OIIO::ImageSpec& spec) {
  const int colors = spec.nchannels < 3 ? 1 : 3;
  return spec.alpha_channel == colors ? colors + 1 : colors;
}

/// Degrees, minutes and seconds of a GPS tag, negative where NAMERef has the letter `negative`.
std::optional<double> gps_angle(const OIIO::ImageSpec& spec, const std::string& name,
                                char negative) {
  const OIIO::ParamValue* const parts = spec.find_attribute(name);
  if (!parts) return {};
  double degrees = 0, unit = 1;
  for (int i = 0; i < std::min(3, int(parts->type().basevalues())); ++i, unit /= 60)
    degrees += unit * double(parts->get_float_indexed(i));
  const std::string side(spec.get_string_attribute(name + "Ref"));
  return !side.empty() && side[0] == negative ? -degrees : degrees;
}

/// The altitude; GPS:AltitudeRef is odd below sea level (1) and below the ellipsoid (3).
std::optional<double> gps_altitude(const OIIO::ImageSpec& spec) {
  const OIIO::ParamValue* const altitude = spec.find_attribute("GPS:Altitude");
  if (!altitude) return {};
  const bool is_below = spec.get_int_attribute("GPS:AltitudeRef", 0) % 2 == 1;
  return double(altitude->get_float()) * (is_below ? -1 : 1);
}

/// The values of channels of a map, as they stand in the file.
template <class T>
std::vector<float> values_of(OIIO::ImageInput& input, const MapKind& kind,
                             const std::filesystem::path& path, OIIO::TypeDesc type, int first,
                             int count) {
  const OIIO::ImageSpec& spec = input.spec();
  std::vector<T> values(std::size_t(spec.width) * std::size_t(spec.height) * std::size_t(count));
  const bool done = input.read_image(0, 0, first, first + count, type, values.data());
  const std::string complaint = input.geterror();
  if (!done || !complaint.empty()) cannot_read_map(kind, path, complaint);
  return {values.begin(), values.end()};
}

OIIO::ImageSpec spec_of(const Image8& image) {
  return OIIO::ImageSpec(image.width, image.height, image.channels, OIIO::TypeDesc::UINT8);
}

std::vector<std::uint8_t> encode(const std::string& format, const Image8& image,
                                 const OIIO::ImageSpec& spec) {
  std::vector<unsigned char> bytes;
  OIIO::Filesystem::IOVecOutput sink(bytes);
  const auto output = OIIO::ImageOutput::create(format, &sink);
  const bool done = output && output->open("picture." + format, spec) &&
                    output->write_image(OIIO::TypeDesc::UINT8, image.pixels.data()) &&
                    output->close();
  if (!done)
    throw Error("cannot encode a picture as " + format + ": " +
                (output ? output->geterror() : OIIO::geterror()) + "; reinstall OpenImageIO");
  return bytes;
}

}  // namespace

Image8 decode_photo(const std::filesystem::path& path) {
  const OpenPhoto photo = open_photo(path);
  Image8 image(photo.size.width, photo.size.height, channels_of(photo.input->spec()));
  const bool done =
      photo.input->read_image(0, 0, 0, image.channels, OIIO::TypeDesc::UINT8, image.pixels.data());
  // A JPEG cut short counts as read, its rest gray; only the message tells.
  const std::string complaint = photo.input->geterror();
  if (!done || !(complaint.empty() || is_harmless(complaint))) cannot_read_photo(path, complaint);
  if (!complaint.empty()) log_warning("{}: {}", path.string(), complaint);
  return image;
}

MapFile decode_map(const MapKind& kind, const std::filesystem::path& path) {
  const OpenPhoto photo = open_photo(path);
  const OIIO::ImageSpec& spec = photo.input->spec();
  const std::pair<int, int> channels = kind.channels(spec.channelnames);
  MapFile map{ImageF(spec.width, spec.height, channels.second), true, 8 * int(spec.format.size())};
  const auto read = [&]<class T>(OIIO::TypeDesc type) {
    map.values.pixels =
        values_of<T>(*photo.input, kind, path, type, channels.first, channels.second);
  };
  switch (spec.format.basetype) {
    case OIIO::TypeDesc::UINT8: read.operator()<std::uint8_t>(OIIO::TypeDesc::UINT8); break;
    case OIIO::TypeDesc::UINT16: read.operator()<std::uint16_t>(OIIO::TypeDesc::UINT16); break;
    case OIIO::TypeDesc::HALF:
    case OIIO::TypeDesc::FLOAT:
      read.operator()<float>(OIIO::TypeDesc::FLOAT);
      map.has_steps = false;
      break;
    default:
      cannot_read_map(kind, path, fmt::format("its values have the type {}", spec.format.c_str()));
  }
  return map;
}

PhotoSize decode_photo_size(const std::filesystem::path& path) { return open_photo(path).size; }

int decode_photo_orientation(const std::filesystem::path& path) {
  const OpenPhoto photo = open_photo(path);
  return photo.input->spec().get_int_attribute("Orientation", 1);
}

std::optional<Geodetic> decode_photo_place(const std::filesystem::path& path) {
  const OpenPhoto photo = open_photo(path);
  const OIIO::ImageSpec& spec = photo.input->spec();
  const auto latitude = gps_angle(spec, "GPS:Latitude", 'S');
  const auto longitude = gps_angle(spec, "GPS:Longitude", 'W');
  const auto altitude = gps_altitude(spec);
  if (!latitude || !longitude || !altitude) return {};
  return Geodetic{*longitude, *latitude, *altitude};
}

ExposureTags decode_exposure_tags(const std::filesystem::path& path) {
  const OpenPhoto photo = open_photo(path);
  const OIIO::ImageSpec& spec = photo.input->spec();
  const auto number = [&](const char* name) { return double(spec.get_float_attribute(name)); };
  // The name of the ISO tag has changed with versions of EXIF and of OpenImageIO.
  double iso = number("Exif:PhotographicSensitivity");
  if (!(iso > 0)) iso = number("Exif:ISOSpeedRatings");
  return {number("ExposureTime"), number("FNumber"), iso};
}

std::string codec_name() { return "OpenImageIO " OIIO_VERSION_STRING; }

std::vector<std::uint8_t> encode_jpeg_copy(const std::filesystem::path& photo,
                                           const Image8& image) {
  GS_CHECK(image.channels == 3);
  OIIO::ImageSpec spec = spec_of(image);
  spec.extra_attribs = open_photo(photo).input->spec().extra_attribs;  // EXIF, color profile
  spec.attribute("Orientation", 1);
  spec.attribute("Compression", "jpeg:" + std::to_string(kCopyQuality));
  spec.attribute("jpeg:subsampling", "4:4:4");
  return encode("jpeg", image, spec);
}

std::vector<std::uint8_t> encode_jpeg_alone(const Image8& image, int quality) {
  GS_CHECK(image.channels == 3);
  OIIO::ImageSpec spec = spec_of(image);
  spec.attribute("Compression", "jpeg:" + std::to_string(quality));
  return encode("jpeg", image, spec);
}

}  // namespace gs
