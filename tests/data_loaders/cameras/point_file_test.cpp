// SPDX-License-Identifier: Apache-2.0
// Clouds of points. The LAS files are written here by the tables of the specification.
#include "data_loaders/points/point_file.h"

#include <gmock/gmock.h>

#include <cmath>

#include "data_loaders/points/points_beside.h"
#include "gs_core/error.h"
#include "tests/support/captured_log.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

/// A LAS file of few points.
struct Las {
  int minor = 2, format = 2;
  std::uint32_t counted = 2;       // points, as the header says
  std::size_t more_bytes = 0;      // of each record, behind those of the format
  std::uint16_t brightness = 257;  // of one step of 255 of a color
  int flags = 0, kind = 2;         // of the second point
  Vec3d scale{0.01, 0.01, 0.001}, offset{500000.0, 5400000.0, 100.0};

  bool is_wide() const { return format >= 6; }
  int color_at() const {
    const int at[] = {0, 0, 20, 28, 0, 28, 0, 30, 30, 0, 30};
    return at[format];
  }
  std::size_t record_bytes() const {
    const std::size_t bytes[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
    return bytes[format] + more_bytes;
  }

  std::string header(std::uint32_t begin) const {
    Bytes out;
    out.add_text("LASF").add_text(std::string(20, '\0'));
    out.add<std::uint8_t>(1).add<std::uint8_t>(std::uint8_t(minor));
    out.add_text(std::string(94 - 26, ' '));
    const std::uint16_t size = minor == 4 ? 375 : minor == 3 ? 235 : 227;
    out.add(size).add(begin).add<std::uint32_t>(0);
    out.add<std::uint8_t>(std::uint8_t(format)).add<std::uint16_t>(std::uint16_t(record_bytes()));
    out.add<std::uint32_t>(is_wide() ? 0 : counted).add_text(std::string(20, '\0'));
    for (const Vec3d& v : {scale, offset}) out.add(v.x).add(v.y).add(v.z);
    out.add_text(std::string(48, '\0'));  // the extent
    if (minor >= 3) out.add<std::uint64_t>(0);
    if (minor >= 4)
      out.add<std::uint64_t>(0).add<std::uint32_t>(0).add<std::uint64_t>(counted).add_text(
          std::string(120, '\0'));
    return out.str();
  }
  std::string record(int x, int y, int z, int red, int green, int blue, bool is_second) const {
    std::string bytes(record_bytes(), '\0');
    const auto put = [&](std::size_t at, auto value) {
      std::memcpy(bytes.data() + at, &value, sizeof value);
    };
    put(0, std::int32_t(x)), put(4, std::int32_t(y)), put(8, std::int32_t(z));
    const int class_of = is_second ? kind : 2, flag = is_second ? flags : 0;
    if (is_wide())
      put(15, std::uint8_t(flag ? 4 : 0)), put(16, std::uint8_t(class_of));
    else
      put(15, std::uint8_t((flag ? 0x80 : 0) | class_of));
    const int colors[] = {red, green, blue};
    if (color_at() > 0)
      for (std::size_t k = 0; k < 3; ++k)
        put(std::size_t(color_at()) + 2 * k, std::uint16_t(colors[k] * brightness));
    return bytes;
  }
  /// There are five bytes between header and points, as records of other programs.
  std::string bytes() const {
    const std::string gap = "other", head = header(0);
    return header(std::uint32_t(head.size() + gap.size())) + gap +
           record(100, -200, 3000, 0, 51, 255, false) + record(-5, 7, -9, 1, 2, 3, true);
  }
};

class PointFiles : public FolderTest {
 protected:
  std::vector<ColmapPoint> read(const Las& las, const std::string& name = "cloud.las") const {
    write_bytes(path(name), las.bytes());
    return read_point_file(path(name));
  }
  std::string error(const Las& las) const {
    return error_of([&] { read(las); });
  }
};

TEST_F(PointFiles, EveryVersionAndFormatOfLasIsRead) {
  for (int minor = 0; minor <= 4; ++minor)
    for (int format = 0; format <= 10; ++format) {
      if (format >= 6 && minor < 4) continue;
      SCOPED_TRACE(testing::Message() << "LAS 1." << minor << ", format " << format);
      Las las;
      las.minor = minor, las.format = format;
      las.more_bytes = std::size_t(format % 3);
      const std::vector<ColmapPoint> points = read(las, "Cloud.LAS");
      ASSERT_THAT(points, SizeIs(2));
      EXPECT_EQ(points[0].id, 1u);
      EXPECT_EQ(points[0].position, Vec3d(500001.0, 5399998.0, 103.0));
      EXPECT_EQ(points[1].position, Vec3d(500000 - 0.05, 5400000 + 0.07, 100 - 0.009));
      if (las.color_at() > 0) {
        EXPECT_THAT(points[0].color, ElementsAre(0, 51, 255));
        EXPECT_THAT(points[1].color, ElementsAre(1, 2, 3));
      } else {
        EXPECT_THAT(points[0].color, ElementsAre(128, 128, 128));
      }
    }
}

TEST_F(PointFiles, ColorsOfLasMayBeBytesOrNone) {
  Las las;
  las.brightness = 1;
  EXPECT_THAT(read(las)[0].color, ElementsAre(0, 51, 255));
  las.brightness = 0;
  EXPECT_THAT(read(las)[0].color, ElementsAre(128, 128, 128));
}

TEST_F(PointFiles, NoiseAndWithheldPointsAreLeftOut) {
  for (const int format : {2, 7}) {
    Las las;
    las.minor = 4, las.format = format, las.kind = 7;
    EXPECT_THAT(read(las), SizeIs(1));
    las.kind = 2, las.flags = 1;
    CapturedLog logged;
    EXPECT_THAT(read(las), SizeIs(1));
    EXPECT_THAT(logged.text(), HasSubstr("1 of 2 points"));
  }
}

TEST_F(PointFiles, LasThatCannotBeReadIsRefused) {
  Las las;
  las.format = 2 | 0x80;
  write_bytes(path("cloud.laz"), [&] {
    std::string bytes = Las().bytes();
    bytes[104] = char(las.format);
    return bytes;
  }());
  EXPECT_THAT(error_of([&] { read_point_file(path("cloud.laz")); }),
              AllOf(HasSubstr("cloud.laz"), HasSubstr("compressed (LAZ)"), HasSubstr("laszip")));
  las = {};
  las.counted = 3;
  EXPECT_THAT(error(las), AllOf(HasSubstr("promises 3 points, but only 2 follow")));
  las = {};
  las.minor = 5;
  EXPECT_THAT(error(las), HasSubstr("it is LAS 1.5"));
  las = {};
  las.scale.y = NAN;
  EXPECT_THAT(error(las), HasSubstr("scale or offset"));
  for (const std::size_t length : {0, 3, 100, 226, 230, 250})
    EXPECT_THAT(error_of([&] {
                  write_bytes(path("cloud.las"), Las().bytes().substr(0, length));
                  read_point_file(path("cloud.las"));
                }),
                HasSubstr("cloud.las"))
        << length;
}

TEST_F(PointFiles, PlyKeepsTheDigitsOfAMap) {
  const std::string head =
      "element vertex 1\nproperty double x\nproperty double y\nproperty double z\nproperty ushort "
      "diffuse_red\nproperty ushort diffuse_green\nproperty ushort diffuse_blue\nend_header\n";
  write_bytes(path("a.ply"),
              "ply\nformat ascii 1.0\n" + head + "500000.125 5400000.0625 -12.5 0 13107 65535\n");
  Bytes binary;
  binary.add_text("ply\nformat binary_little_endian 1.0\n" + head);
  binary.add(500000.125).add(5400000.0625).add(-12.5);
  binary.add<std::uint16_t>(0).add<std::uint16_t>(13107).add<std::uint16_t>(65535);
  write_bytes(path("b.ply"), binary.str());
  for (const char* name : {"a.ply", "b.ply"}) {
    const std::vector<ColmapPoint> points = read_point_file(path(name));
    ASSERT_THAT(points, SizeIs(1));
    EXPECT_EQ(points[0].position, Vec3d(500000.125, 5400000.0625, -12.5));
    EXPECT_THAT(points[0].color, ElementsAre(0, 51, 255));
  }
}

/// A PLY with a point 2 in front of the cameras of PointsBeside.
const char* const kCloud =
    "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float "
    "z\nend_header\n0 0 2\n";

class PointsBeside : public FolderTest {
 protected:
  PointsBeside() {
    cameras_.cameras[1] = {1, CameraModel::pinhole, 40, 30, {36, 36, 20, 15}};
    for (int i = 0; i < 5; ++i) {
      ColmapImage& image = cameras_.images.emplace_back();
      image.camera_id = 1;
      image.cam_from_world_translation = {0.1 * i, 0.0, 0.0};
    }
  }
  void SetUp() override {
    FolderTest::SetUp();
    write_bytes(path("scene/export/deep/cameras.xml"), "<document>");
  }
  std::vector<ColmapPoint> read() {
    logged_.emplace();
    return points_beside(cameras_, path("scene"), path("scene/export/deep/cameras.xml"));
  }
  ColmapModel cameras_;
  std::optional<CapturedLog> logged_;
};

TEST_F(PointsBeside, TheNearestFileIsTaken) {
  EXPECT_THAT(read(), IsEmpty());
  write_bytes(path("unrelated.ply"), kCloud);
  EXPECT_THAT(read(), IsEmpty());
  write_bytes(path("scene/above.ply"), kCloud);
  EXPECT_THAT(read(), SizeIs(1));
  write_bytes(
      path("scene/export/deep/mesh.ply"),
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty "
      "float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 2\n1 "
      "0 2\n0 1 2\n3 0 1 2\n");
  EXPECT_THAT(read(), SizeIs(3));
  write_bytes(
      path("scene/export/deep/model.ply"),
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty "
      "float z\nproperty float f_dc_0\nend_header\n0 0 2 1\n");
  EXPECT_THAT(read(), SizeIs(3)) << "Gaussians are no cloud";
  write_bytes(path("scene/export/deep/cloud.ply"), kCloud);
  EXPECT_THAT(read(), SizeIs(1));
  EXPECT_THAT(logged_->text(), HasSubstr("1 points are those of"));
  write_bytes(path("scene/export/deep/dense.ply"), kCloud);
  EXPECT_THAT(read(), IsEmpty());
  EXPECT_THAT(logged_->text(), AllOf(HasSubstr("cloud.ply, dense.ply"), HasSubstr("leave one")));
}

TEST_F(PointsBeside, PointsOfOtherCoordinatesAreLeftOut) {
  for (const char* place : {"0 0 -2", "500000 5400000 2", "0 0 5400000"}) {
    std::string cloud = kCloud;
    cloud.replace(cloud.find("0 0 2"), 5, place);
    write_bytes(path("scene/export/cloud.ply"), cloud);
    EXPECT_THAT(read(), IsEmpty()) << place;
    EXPECT_THAT(logged_->text(),
                AllOf(HasSubstr("see 0 % of the points"), HasSubstr("same local coordinates")));
  }
}

TEST_F(PointsBeside, AFileThatCannotBeReadIsAWarning) {
  write_bytes(path("scene/export/cloud.laz"), "LASF");
  EXPECT_THAT(read(), IsEmpty());
  EXPECT_THAT(logged_->text(), AllOf(HasSubstr("cloud.laz"), HasSubstr("without points")));
}

}  // namespace
}  // namespace gs
