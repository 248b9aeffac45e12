// SPDX-License-Identifier: Apache-2.0
// How photos were exposed, by EXIF: through the photo reader of the build, and through our own
// reader of JPEG files, which builds without OpenImageIO use.
#include <gtest/gtest.h>

#include <cmath>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/exif_tags.h"
#include "data_loaders/photos/photos.h"
#include "tests/support/exif_photo.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

std::optional<float> stops_of(const std::string& bytes) {
  const TempFolder temp;
  write_bytes(temp.path() / "photo.jpg", bytes);
  return read_exposure_stops(temp.path() / "photo.jpg");
}

ExposureTags own_tags_of(const std::string& bytes) {
  return exposure_tags_of_jpeg({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
}

constexpr Exposed kExposed{0.008, 2.8, 400};

TEST(Exif, ExposureIsTheLogarithmOfTheLight) {
  for (const bool is_big : {false, true}) {
    const std::optional<float> stops = stops_of(exposed_photo(16, 8, kExposed, is_big));
    ASSERT_TRUE(stops) << is_big;
    EXPECT_NEAR(*stops, std::log2(0.008 * 400 / (2.8 * 2.8)), 1e-4) << is_big;
  }
  EXPECT_NEAR(*stops_of(exposed_photo(16, 8, {0.016, 2.8, 400})) -
                  *stops_of(exposed_photo(16, 8, kExposed)),
              1, 1e-4);
}

TEST(Exif, ExposureIsUnknownWhereATagIsMissing) {
  for (const Exposed& exposed :
       {Exposed{}, Exposed{0, 2.8, 400}, Exposed{0.008, 0, 400}, Exposed{0.008, 2.8, 0}})
    EXPECT_FALSE(stops_of(exposed_photo(16, 8, exposed)));
  const std::vector<std::uint8_t> plain = encode_jpeg(Image8(16, 8, 3, 128), 90);
  EXPECT_FALSE(stops_of({plain.begin(), plain.end()}));
}

TEST(Exif, OwnReaderFindsTheTags) {
  for (const bool is_big : {false, true}) {
    const ExposureTags tags = own_tags_of(exposed_photo(16, 8, kExposed, is_big));
    EXPECT_NEAR(tags.seconds, 0.008, 1e-9) << is_big;
    EXPECT_NEAR(tags.f_number, 2.8, 1e-9) << is_big;
    EXPECT_EQ(tags.iso, 400) << is_big;
  }
}

// Whatever is cut off or overwritten, nothing is read beyond the end; the sanitizers would say so.
TEST(Exif, OwnReaderSurvivesDamage) {
  const std::string whole = exposed_photo(16, 8, kExposed);
  const std::size_t head = 2 + exif_segment(exposure_tiff(kExposed)).size();
  for (std::size_t size = 0; size <= head; ++size) {
    const ExposureTags tags = own_tags_of(std::string(whole.data(), size));
    EXPECT_EQ(tags.seconds * tags.f_number * tags.iso > 0, size == head) << size;
  }
  for (std::size_t at = 0; at < head; ++at)
    for (const char byte : {'\0', '\x7f', '\xff'}) {
      std::string damaged = whole.substr(0, head);
      damaged[at] = byte;
      const ExposureTags tags = own_tags_of(damaged);
      EXPECT_TRUE(tags.seconds >= 0 && tags.f_number >= 0 && tags.iso >= 0) << at;
    }
}

}  // namespace
}  // namespace gs
