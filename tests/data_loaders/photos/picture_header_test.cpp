// SPDX-License-Identifier: Apache-2.0
// Headers that promise more than a file can be worth, refused before a decoder opens the file.
#include "data_loaders/photos/picture_header.h"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include "data_loaders/photos/photos.h"
#include "gs_core/error.h"
#include "tests/support/temp_folder.h"
#include "tests/support/tiny_photos.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using namespace std::string_literals;

class PictureHeaders : public ::testing::Test {
 protected:
  std::filesystem::path file() const { return folder_.path() / "photo.jpg"; }
  PictureHeader header_of(const std::string& bytes) {
    write_bytes(file(), bytes);
    return read_picture_header(file());
  }
  /// What check_picture() says of these bytes; "" if nothing.
  std::string refusal_of(const std::string& bytes) {
    const PictureHeader header = header_of(bytes);
    try {
      check_picture(file(), header);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

 private:
  TempFolder folder_;
};

std::string two(unsigned value) { return {char(value >> 8), char(value)}; }

/// A progressive JPEG of so many pixels and scans without data.
std::string jpeg_of(unsigned width, unsigned height, int scans) {
  std::string bytes = "\xFF\xD8\xFF\xC2"s + two(17) + "\x08" + two(height) + two(width) +
                      "\x03\x01\x11\0\x02\x11\0\x03\x11\0"s;
  for (int i = 0; i < scans; ++i) bytes += "\xFF\xDA"s + two(8) + "\x01\x01\0\0\0\0 data \xFF\0"s;
  return bytes + "\xFF\xD9";
}

TEST_F(PictureHeaders, SmallPhotosAreReadAndAllowed) {
  const std::string png(reinterpret_cast<const char*>(kGrayPng), sizeof kGrayPng);
  EXPECT_EQ(header_of(png).width, 2u);
  EXPECT_EQ(header_of(png).height, 1u);
  EXPECT_EQ(refusal_of(png), "");
  const std::string jpeg(reinterpret_cast<const char*>(kTurnedJpeg), sizeof kTurnedJpeg);
  EXPECT_EQ(header_of(jpeg).width, 16u);
  EXPECT_EQ(header_of(jpeg).height, 8u);
  EXPECT_EQ(refusal_of(jpeg), "");
}

TEST_F(PictureHeaders, ANumberInWhichTheFileEndsIsZero) {
  EXPECT_EQ(header_of("\x89PNG\r\n\x1A\n\0\0\0\x0DIHDR\xFF\xFF"s).width, 0u);
}

TEST_F(PictureHeaders, HugePicturesInTinyFilesAreRefused) {
  const std::string gif = "GIF89a\xFF\xFF\xFF\xFF"s + std::string(80, '\0');
  const std::string large_gif = "GIF89a\x00\x40\x00\x40"s + std::string(80, '\0');
  const std::string odd_gif = "GIFxyz\xFF\xFF\xFF\xFF"s + std::string(80, '\0');
  const std::string webp = "RIFF\0\0\0\0WEBPVP8X\x0A\0\0\0\0\0\0\0\xFF\x3F\0\xFF\x3F\0"s;
  const std::string webp_chunk = "/\xFF\xFF\xFF\x0F"s,
                    lossy_chunk = "\x10\0\0\x9D\x01\x2A\xFF\x3F\xFF\x3F"s;
  const std::string tiff =
      "II*\0\x08\0\0\0\x02\0\0\x01\x03\0\x01\0\0\0\xFF\xFF\0\0\x01\x01\x03\0\x01\0\0\0\xFF\xFF\0\0"s;
  for (const std::string& bytes :
       {gif, large_gif, odd_gif, webp, webp_chunk, lossy_chunk, tiff, jpeg_of(20'000, 20'000, 10)})
    EXPECT_THAT(refusal_of(bytes), AllOf(HasSubstr("photo.jpg"), HasSubstr("its header says")));
}

TEST_F(PictureHeaders, TheLargestFrameOfAJpegCounts) {
  const std::string large = jpeg_of(20'000, 300, 0), small = jpeg_of(8, 400, 10);
  const PictureHeader header = header_of(large.substr(0, large.size() - 2) + small.substr(2));
  EXPECT_EQ(header.width, 20'000u);
  EXPECT_EQ(header.height, 400u);
}

/// The header of a PNG of 8 bits.
std::string png_of(unsigned width, unsigned height, char color_type) {
  return "\x89PNG\r\n\x1A\n\0\0\0\x0DIHDR"s + "\0\0"s + two(width) + "\0\0"s + two(height) +
         "\x08"s + color_type + "\0\0\0"s;
}

TEST_F(PictureHeaders, MasksOfLargeCamerasAreAllowed) {
  const std::string rest(100'000, '\0');                      // a mask packs a thousand to one
  EXPECT_EQ(refusal_of(png_of(9504, 6336, 0) + rest), "");    // 60 million pixels, gray
  EXPECT_EQ(refusal_of(png_of(11648, 8736, 6) + rest), "");   // 102 million, color and alpha
  EXPECT_EQ(refusal_of(png_of(14204, 10652, 0) + rest), "");  // 151 million, gray
  EXPECT_NE(refusal_of(png_of(22000, 22000, 6) + rest), "");
}

TEST_F(PictureHeaders, AProgressiveJpegOfThousandsOfScansIsRefused) {
  EXPECT_EQ(header_of(jpeg_of(100, 100, 10)).scans, 10u);
  EXPECT_EQ(refusal_of(jpeg_of(100, 100, 10)), "");
  EXPECT_THAT(refusal_of(jpeg_of(100, 100, 3000)), HasSubstr("scans"));
}

/// The header of an EXR of one channel of halves, with one more attribute.
std::string exr_of(unsigned width, unsigned height, const std::string& more = "") {
  const auto four = [](unsigned value) {
    return std::string{char(value), char(value >> 8), char(value >> 16), char(value >> 24)};
  };
  return "\x76\x2F\x31\x01\x02\0\0\0"s + "channels\0chlist\0"s + four(19) + "Z\0"s + four(1) +
         std::string(12, '\0') + "\0"s + "dataWindow\0box2i\0"s + four(16) + four(0) + four(0) +
         four(width - 1) + four(height - 1) + more + "\0"s;
}

TEST_F(PictureHeaders, AnExrThatPromisesMoreThanItHoldsIsRefused) {
  const PictureHeader header = header_of(exr_of(40, 30));
  EXPECT_EQ(header.width, 40u);
  EXPECT_EQ(header.height, 30u);
  EXPECT_GE(header.bytes_per_pixel, 2u);
  EXPECT_EQ(refusal_of(exr_of(40, 30)), "");
  EXPECT_EQ(refusal_of(exr_of(40, 30, "note\0string\0\x04\0\0\0text"s)), "");
  EXPECT_THAT(refusal_of(exr_of(40, 30, "note\0string\0\x6C\x6C\x6E\x65text"s)),
              AllOf(HasSubstr("photo.jpg"), HasSubstr("longer than the file")));
  EXPECT_THAT(refusal_of(exr_of(40, 30, "note\0string\0\xFF\xFF\xFF\xFFtext"s)),
              HasSubstr("longer than the file"));
  // OpenEXR takes four bytes here, and the channels up to an empty name.
  EXPECT_THAT(refusal_of(exr_of(40, 30, "note\0int\0\x03\0\0\0abc"s)), HasSubstr("than its kind"));
  std::string long_name = exr_of(40, 30);
  long_name.replace(long_name.find("Z\0"s), 2, "ZZ");
  EXPECT_THAT(refusal_of(long_name), HasSubstr("than its kind"));
  EXPECT_THAT(refusal_of(exr_of(40, 30, "n\0stringvector\0\x08\0\0\0\x40\0\0\0abcd"s)),
              HasSubstr("than its kind"));
  EXPECT_THAT(refusal_of(exr_of(20'000, 20'000)), HasSubstr("its header says"));
  EXPECT_THAT(refusal_of(exr_of(1, 1u << 28)), HasSubstr("its header says"));
}

TEST_F(PictureHeaders, AHeaderMayEndAnywhere) {
  const std::string webp = "RIFF\0\0\0\0WEBPVP8X\x0A\0\0\0\0\0\0\0\x01\0\0\0\0\0"s;
  const std::string tiff = "II*\0\x08\0\0\0\x01\0\0\x01\x03\0\x01\0\0\0\x02\0\0\0"s;
  const std::string bmp = "BM"s + std::string(12, '\0') + "\x28\0\0\0\x02\0\0\0\x01\0\0\0"s;
  for (const std::string& bytes :
       {webp, tiff, bmp, jpeg_of(2, 1, 2), png_of(2, 1, 0), exr_of(2, 1)})
    for (std::size_t length = 0; length < bytes.size(); ++length)
      EXPECT_NO_THROW(header_of(bytes.substr(0, length))) << bytes.substr(0, 4) << length;
}

TEST_F(PictureHeaders, AFifoIsRefusedAtOnce) {
  ASSERT_EQ(mkfifo(file().c_str(), 0600), 0);
  EXPECT_THROW(read_picture_header(file()), Error);
  EXPECT_THROW(read_photo_size(file()), Error);
}

}  // namespace
}  // namespace gs
