// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as .sog. An input is a file, or # and then meta.json and the pixels of the
// pictures, which the target packs as WebP and zip, so that no checksum refuses them; or, from { on,
// the meta.json of a folder of pictures. Bytes of WebP themselves are libwebp's to read.
#include "gs_model/formats/sog/sog.h"

#include <algorithm>

#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/sog/webp.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/random_model.h"

namespace gs::fuzz {
namespace {

/// Pixels of four bytes behind a byte that is a quarter of the picture's width. The last row may end
/// early.
Image8 picture_of(std::string_view bytes) {
  const int width = bytes.empty() ? 1 : 4 * (static_cast<unsigned char>(bytes[0]) + 1);
  const std::string_view pixels = bytes.substr(std::min<std::size_t>(1, bytes.size()));
  const std::size_t row = 4 * std::size_t(width);
  Image8 picture(width, int(std::max<std::size_t>(1, (pixels.size() + row - 1) / row)), 4);
  std::copy(pixels.begin(), pixels.end(), picture.pixels.begin());
  return picture;
}

std::string packed(std::string_view parts) {
  std::vector<ZipEntry> entries;
  for (const char* name : {"meta.json", "means_l.webp", "means_u.webp", "quats.webp", "scales.webp",
                           "sh0.webp", "shN_centroids.webp", "shN_labels.webp"}) {
    const std::size_t end = parts.find(kNextFile);
    const std::string_view part = parts.substr(0, end);
    entries.push_back({name, entries.empty() ? std::string(part) : webp_of(picture_of(part))});
    if (end == parts.npos) break;
    parts.remove_prefix(end + kNextFile.size());
  }
  return zip_of(entries);
}

/// A folder with the pictures of ten Gaussians; empty in a build without libwebp.
void make_folder() {
  std::filesystem::create_directories(folder() / "sog");
  MemorySink archive("ten Gaussians");
  if (!takes([&] { write_sog(archive, random_model(10, 1)); })) return;
  for (const auto& [name, content] : zip_entries("", archive.text))
    file_of("sog/" + std::string(name), content);
}

void read(std::string_view bytes) {
  if (bytes.starts_with('{')) {
    static const bool is_made = (make_folder(), true);
    static_cast<void>(is_made);
    takes([&] { read_sog_folder(file_of("sog/meta.json", bytes)); });
    return;
  }
  const bool is_unpacked = bytes.starts_with('#');
  takes([&] {
    read_sog(is_unpacked ? file_of("model.sog", packed(bytes.substr(1)))
                         : file_of("model.sog", bytes));
  });
}

const Registered registered{"sog", read};

}  // namespace
}  // namespace gs::fuzz
