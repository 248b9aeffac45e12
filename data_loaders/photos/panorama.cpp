// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/panorama.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <string_view>

#include "data_loaders/photos/exif_tags.h"
#include "gs_core/system/byte_reader.h"

namespace gs {
namespace {

constexpr std::uint64_t kHeadBytes = 1 << 18;  // EXIF with its preview, and XMP behind it
constexpr int kLeastWidth = 3000;              // pixels; smaller ones of this shape may be anything
constexpr std::string_view kProjection = "ProjectionType", kSphere = "equirectangular";

}  // namespace

bool is_panorama(const std::filesystem::path& photo, const PhotoSize& size) {
  if (size.width != 2 * size.height) return false;
  ByteReader file(photo);
  const auto count = std::size_t(std::min(file.size(), kHeadBytes));
  const std::uint8_t* const bytes = file.peek(count);
  const std::string_view head(reinterpret_cast<const char*>(bytes), count);
  if (const std::size_t at = head.find(kProjection); at != head.npos)
    return head.substr(at, 64).find(kSphere) != head.npos;
  return size.width >= kLeastWidth && !has_focal_length_of_jpeg({bytes, count});
}

std::string panorama_xmp(int width, int height) {
  return fmt::format(
      R"(<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF )"
      R"(xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" )"
      R"(xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" )"
      R"(GPano:ProjectionType="equirectangular" GPano:UsePanoramaViewer="True" )"
      R"(GPano:FullPanoWidthPixels="{0}" GPano:FullPanoHeightPixels="{1}" )"
      R"(GPano:CroppedAreaImageWidthPixels="{0}" GPano:CroppedAreaImageHeightPixels="{1}" )"
      R"(GPano:CroppedAreaLeftPixels="0" GPano:CroppedAreaTopPixels="0"/></rdf:RDF></x:xmpmeta>)",
      width, height);
}

}  // namespace gs
