// SPDX-License-Identifier: Apache-2.0
// LAS, by "LAS Specification 1.4 - R15" of ASPRS (2019). All numbers are little-endian. A header
// says where records of one size begin; X, Y and Z are whole numbers, with a scale and an offset.
#include "data_loaders/points/las_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/points/point_file.h"
#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/log.h"
#include "gs_model/formats/coding/little_endian.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kHeaderBytes = 227;               // of LAS 1.0 to 1.2
constexpr std::size_t kHeaderBytes14 = 375;             // of LAS 1.4
constexpr std::uint8_t kCompressed = 0xc0;              // bits of the format that LASzip sets
constexpr std::uint8_t kLowNoise = 7, kHighNoise = 18;  // classes
constexpr std::size_t kBlockRecords = 4096;

/// What a point format has: the bytes of a record, and where its colors lie (0: it has none).
struct PointFormat {
  std::size_t bytes, color;
};
constexpr PointFormat kFormats[] = {{20, 0}, {28, 0},  {26, 20}, {34, 28}, {57, 0}, {63, 28},
                                    {30, 0}, {36, 30}, {38, 30}, {59, 0},  {67, 30}};
constexpr std::uint8_t kFirstWideFormat = 6;  // from which on flags and class have a byte each

struct LasHeader {
  std::uint64_t points = 0;  // their number
  std::uint64_t begin = 0;   // bytes before the first record
  std::uint8_t format = 0;
  std::size_t record = 0;  // bytes
  Vec3d scale{0.0}, offset{0.0};

  bool has_color() const { return kFormats[format].color != 0; }
};

LasHeader read_las_header(ByteReader& file) {
  const auto fail = [&](const std::string& what) { cannot_read(file.path(), what); };
  if (file.size() < kHeaderBytes || std::memcmp(file.peek(4), "LASF", 4) != 0)
    fail("it is no LAS; export the points again, as LAS or PLY");
  const std::uint8_t* h =
      file.peek(std::size_t(std::min<std::uint64_t>(file.size(), kHeaderBytes14)));
  const int major = h[24], minor = h[25];
  if (major != 1 || minor > 4)
    fail(fmt::format("it is LAS {}.{}; export the points as LAS 1.2 to 1.4, or as PLY", major,
                     minor));
  LasHeader header;
  header.format = h[104];
  if (header.format & kCompressed)
    fail(
        "it is compressed (LAZ), which gemsplat does not read; convert it with "
        "`laszip -i IN.laz -o OUT.las`, or export the points as PLY or LAS");
  if (header.format >= std::size(kFormats))
    fail(fmt::format("its points have the format {}; export them as LAS with a format of 0 to 10",
                     header.format));
  header.begin = load_little<std::uint32_t>(h + 96);
  header.record = load_little<std::uint16_t>(h + 105);
  header.points = load_little<std::uint32_t>(h + 107);
  if (minor == 4 && file.size() >= kHeaderBytes14)
    if (const auto points = load_little<std::uint64_t>(h + 247); points > 0) header.points = points;
  for (int axis = 0; axis < 3; ++axis) {
    header.scale[axis] = load_little<double>(h + 131 + 8 * axis);
    header.offset[axis] = load_little<double>(h + 155 + 8 * axis);
  }
  if (!is_finite(header.scale) || !is_finite(header.offset))
    fail("its scale or offset is no number; export the points again");
  if (header.record < kFormats[header.format].bytes || header.begin < kHeaderBytes ||
      header.begin > file.size())
    fail("its header contradicts itself; export the points again");
  const std::uint64_t held = (file.size() - header.begin) / header.record;
  if (header.points > held)
    fail(
        fmt::format("its header promises {} points, but only {} follow; the file is cut short, "
                    "copy or export it again",
                    header.points, held));
  return header;
}

/// Whether a record is one that its maker does not want to be used.
bool is_left_out(const LasHeader& header, const std::uint8_t* record) {
  const bool is_wide = header.format >= kFirstWideFormat;
  const std::uint8_t kind = is_wide ? record[16] : record[15] & 0x1f;
  const bool is_withheld = record[15] & (is_wide ? 0x04 : 0x80);
  return is_withheld || kind == kLowNoise || kind == kHighNoise;
}

}  // namespace

std::vector<ColmapPoint> read_las_points(const fs::path& path) {
  ByteReader file(path);
  const LasHeader header = read_las_header(file);
  file.skip(header.begin);
  const std::uint64_t every = (header.points + kMostPointsOfFile - 1) / kMostPointsOfFile;
  std::vector<ColmapPoint> points;
  std::vector<std::array<std::uint16_t, 3>> colors;
  std::uint64_t lost = 0;
  std::uint16_t brightest = 0;
  for (std::uint64_t first = 0; first < header.points; first += kBlockRecords) {
    const auto count = std::size_t(std::min<std::uint64_t>(kBlockRecords, header.points - first));
    const std::uint8_t* records = file.take(count * header.record);
    for (std::size_t i = 0; i < count; ++i) {
      if ((first + i) % every != 0) continue;
      const std::uint8_t* record = records + i * header.record;
      const Vec3d whole(load_little<std::int32_t>(record), load_little<std::int32_t>(record + 4),
                        load_little<std::int32_t>(record + 8));
      const Vec3d position = whole * header.scale + header.offset;
      if (is_left_out(header, record) || !is_finite(position)) {
        ++lost;
        continue;
      }
      points.push_back({points.size() + 1, position, {128, 128, 128}});
      if (!header.has_color()) continue;
      auto& color = colors.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) {
        color[k] = load_little<std::uint16_t>(record + kFormats[header.format].color + 2 * k);
        brightest = std::max(brightest, color[k]);
      }
    }
  }
  // Colors have 16 bits, but some programs write bytes. Without any color all of them are 0.
  for (std::size_t i = 0; i < colors.size() && brightest > 0; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      points[i].color[k] = std::uint8_t(brightest > 255 ? colors[i][k] >> 8 : colors[i][k]);
  if (lost > 0)
    log_info("{} of {} points in {} are noise or withheld: left out", lost, points.size() + lost,
             path.string());
  return points;
}

}  // namespace gs
