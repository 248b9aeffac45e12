// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/ksplat.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/system/byte_reader.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/half.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"

namespace gs {
namespace {

constexpr std::size_t kHeaderBytes = 4096, kSectionBytes = 1024, kCenterBytes = 12;
constexpr float kUsualShRange = 1.5f;
constexpr std::uint32_t kUsualRange = 32767;

/// Bytes of a number in positions, scales and rotations, and in SH, by level.
constexpr std::size_t kNumberBytes[] = {4, 2, 2}, kShBytes[] = {4, 2, 1};

/// The file's bytes, and Errors about them.
class Bytes {
 public:
  Bytes(const std::filesystem::path& path, std::string_view all) : path_(path), all_(all) {}

  std::string_view part(std::uint64_t offset, std::uint64_t count) const {
    if (offset > all_.size() || count > all_.size() - offset) fail("ends too early");
    return all_.substr(offset, count);
  }
  std::uint64_t size() const { return all_.size(); }
  [[noreturn]] void fail(const std::string& what) const {
    cannot_read(path_, fmt::format("as a .ksplat it {}; the file is damaged or of another kind, "
                                   "copy or export it again",
                                   what));
  }
  [[noreturn]] void refuse(const std::string& why) const { cannot_read(path_, why); }

 private:
  const std::filesystem::path& path_;
  std::string_view all_;
};

struct Header {
  std::uint32_t sections = 0;
  unsigned level = 0;
  float least_sh = 0, largest_sh = 0;
};

Header header_of(const Bytes& bytes) {
  const char* at = bytes.part(0, kHeaderBytes).data();
  const unsigned major = std::uint8_t(at[0]), minor = std::uint8_t(at[1]);
  if (major != 0 || minor != 1)
    bytes.refuse(
        fmt::format("it is no .ksplat of version 0.1, but says {}.{}; check what it is, or "
                    "convert it to .ply with the program that wrote it",
                    major, minor));
  Header header{load_little<std::uint32_t>(at + 4), load_little<std::uint16_t>(at + 20),
                load_little<float>(at + 36), load_little<float>(at + 40)};
  if (header.level > 2)
    bytes.refuse(
        fmt::format("it is a .ksplat of level {}, but gemsplat reads 0 to 2; export it "
                    "again at one of these",
                    header.level));
  if (header.sections > (bytes.size() - kHeaderBytes) / kSectionBytes)
    bytes.fail("has more sections than its size allows");
  if (header.least_sh == 0) header.least_sh = -kUsualShRange;
  if (header.largest_sh == 0) header.largest_sh = kUsualShRange;
  return header;
}

struct Section {
  std::uint32_t rows = 0, bucket_rows = 0, full_buckets = 0;
  float block = 0, range = 0;  // S and Q of ksplat.h
  int sh_degree = 0;
  std::size_t row_bytes = 0;
  std::string_view lengths = {}, centers = {}, data = {};
};

/// The section whose header is the `index`-th; `at`, where its data begins, is moved behind it.
Section section_of(const Bytes& bytes, const Header& header, std::uint64_t index,
                   std::uint64_t& at) {
  const char* const fields = bytes.part(kHeaderBytes + index * kSectionBytes, kSectionBytes).data();
  const auto word = [&](int offset) { return load_little<std::uint32_t>(fields + offset); };
  Section section{word(0), word(8), word(32)};
  const std::uint64_t capacity = word(4), buckets = word(12), others = word(36);
  const std::uint64_t center_bytes = load_little<std::uint16_t>(fields + 20);
  section.block = load_little<float>(fields + 16);
  section.range = float(word(24) ? word(24) : kUsualRange);
  section.sh_degree = load_little<std::uint16_t>(fields + 40);
  if (section.sh_degree > kMaxShDegree) bytes.fail("has SH of a degree above 3");
  if (section.rows > capacity) bytes.fail("has a section with more Gaussians than rows");
  if (buckets > 0 && center_bytes != kCenterBytes)
    bytes.fail(fmt::format("has centers of {} bytes", center_bytes));
  section.row_bytes = 10 * kNumberBytes[header.level] + 4 +
                      3 * std::size_t(sh_rest_count(section.sh_degree)) * kShBytes[header.level];
  section.lengths = bytes.part(at, 4 * others);
  section.centers = bytes.part(at + 4 * others, kCenterBytes * buckets);
  at += section.lengths.size() + section.centers.size();
  section.data = bytes.part(at, section.row_bytes * capacity);
  at += section.data.size();
  return section;
}

/// The center of the bucket of each row, for rows in their order.
class BucketCenters {
 public:
  BucketCenters(const Bytes& bytes, const Section& section) : bytes_(bytes), section_(section) {}

  Vec3f next() {
    while (left_ == 0) start_bucket();
    --left_;
    return center_;
  }

 private:
  void start_bucket() {
    const std::uint64_t bucket = next_++;
    if (bucket >= section_.centers.size() / kCenterBytes) bytes_.fail("has rows without a bucket");
    center_ = load_little<Vec3f>(section_.centers.data() + kCenterBytes * bucket);
    if (bucket < section_.full_buckets) {
      left_ = section_.bucket_rows;
      return;
    }
    const std::uint64_t other = bucket - section_.full_buckets;
    if (other >= section_.lengths.size() / 4) bytes_.fail("has rows without a bucket");
    left_ = load_little<std::uint32_t>(section_.lengths.data() + 4 * other);
  }

  const Bytes& bytes_;
  const Section& section_;
  std::uint64_t next_ = 0, left_ = 0;
  Vec3f center_{0.0f};
};

/// Number `index` of floats or of halves.
float number_at(const char* numbers, std::size_t index, unsigned level) {
  return level == 0 ? load_little<float>(numbers + 4 * index)
                    : from_half(load_little<std::uint16_t>(numbers + 2 * index));
}

float sh_at(const char* numbers, std::size_t index, const Header& header) {
  if (header.level < 2) return number_at(numbers, index, header.level);
  return header.least_sh +
         from_unorm(std::uint8_t(numbers[index]), 8) * (header.largest_sh - header.least_sh);
}

void take_sh(const char* numbers, const Header& header, int sh_degree, ShRest& rest) {
  std::size_t next = 0;
  for (int degree = 1; degree <= sh_degree; ++degree)
    for (int channel = 0; channel < 3; ++channel)
      for (int k = sh_rest_count(degree - 1); k < sh_rest_count(degree); ++k)
        rest.coefficient[k][channel] = sh_at(numbers, next++, header);
}

Vec3f position_at(const char* row, const Section& section, const Vec3f& center) {
  Vec3f position;
  for (int axis = 0; axis < 3; ++axis) {
    const auto packed = float(load_little<std::uint16_t>(row + 2 * axis));
    position[axis] = (packed - section.range) * (section.block / 2 / section.range) + center[axis];
  }
  return position;
}

/// Fills the rows of a section, from row `first` on.
void take_section(const Bytes& bytes, const Header& header, const Section& section,
                  std::size_t first, const Gaussians& g) {
  const std::size_t each = kNumberBytes[header.level];
  BucketCenters centers(bytes, section);
  for (std::size_t i = first; i < first + section.rows; ++i) {
    const char* const row = section.data.data() + (i - first) * section.row_bytes;
    const auto number = [&](std::size_t k) { return number_at(row, k, header.level); };
    g.mean[i] =
        header.level == 0 ? load_little<Vec3f>(row) : position_at(row, section, centers.next());
    g.log_scale[i] = log_of_scale({number(3), number(4), number(5)});
    g.rotation[i] = {number(6), number(7), number(8), number(9)};
    normalize(&g.rotation[i].w);
    const char* const color = row + 10 * each;
    for (int k = 0; k < 3; ++k) g.sh0[i][k] = sh0_of_color(from_unorm(std::uint8_t(color[k]), 8));
    g.logit_opacity[i] = logit_of_byte(std::uint8_t(color[3]));
    g.sh_rest[i] = {};
    take_sh(color + 4, header, section.sh_degree, g.sh_rest[i]);
  }
}

}  // namespace

GaussianModel read_ksplat(const std::filesystem::path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  const Bytes bytes(path, {reinterpret_cast<const char*>(reader.take(size)), size});
  const Header header = header_of(bytes);
  std::vector<Section> sections;
  std::uint64_t at = kHeaderBytes + header.sections * std::uint64_t(kSectionBytes);
  std::size_t count = 0;  // no more than fit into the file
  int sh_degree = 0;
  for (std::uint32_t s = 0; s < header.sections; ++s) {
    sections.push_back(section_of(bytes, header, s, at));
    count += sections.back().rows;
    sh_degree = std::max(sh_degree, sections.back().sh_degree);
  }
  GaussianModel model{Gaussians(count, host_memory()), sh_degree, false, false};
  std::size_t first = 0;
  for (const Section& section : sections) {
    take_section(bytes, header, section, first, model.gaussians);
    first += section.rows;
  }
  return model;
}

}  // namespace gs
