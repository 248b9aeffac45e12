// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/exr_header.h"

#include <algorithm>
#include <utility>

namespace gs {
namespace {

/// The attributes of an EXR's header ("Technical Introduction to OpenEXR", file layout): a name, a
/// type, a length and so many bytes, up to an empty name; of a file of several parts, up to two.
/// OpenEXR reads as many bytes as the type asks for, whatever the length says, so both must agree.
class ExrWalk {
 public:
  ExrWalk(const PictureFile& file, PictureHeader& header) : file_(file), header_(header) {
    const bool has_parts = little(file.bytes(4, 4), 0, 4) & 0x1000;
    for (int i = 0; i < kMostAttributes && !header.is_damaged; ++i) {
      const std::string name = word();
      if (!name.empty())
        take_attribute(name);
      else if (!has_parts || at_ >= file.size() || file.bytes(at_, 1)[0] == '\0')
        break;
    }
    // Decoders keep a place for each row, which counts where rows are short.
    header.bytes_per_pixel += 4 + 8 / std::max<std::uint64_t>(header.width, 1);
  }

 private:
  static constexpr int kMostAttributes = 4096;
  static constexpr std::size_t kLongestName = 256;   // with its end
  static constexpr std::size_t kMostList = 1 << 16;  // bytes of a list of channels or of texts
  static constexpr std::pair<std::string_view, std::uint64_t> kSizes[] = {
      {"box2i", 16},      {"box2f", 16},   {"chromaticities", 32},
      {"compression", 1}, {"double", 8},   {"envmap", 1},
      {"float", 4},       {"int", 4},      {"keycode", 28},
      {"lineOrder", 1},   {"m33f", 36},    {"m33d", 72},
      {"m44f", 64},       {"m44d", 128},   {"rational", 8},
      {"tiledesc", 9},    {"timecode", 8}, {"v2i", 8},
      {"v2f", 8},         {"v2d", 16},     {"v3i", 12},
      {"v3f", 12},        {"v3d", 24},     {"deepImageState", 1}};

  /// A name or type, without its end.
  std::string word() {
    const std::string bytes = file_.bytes(at_, kLongestName);
    const std::size_t end = bytes.find('\0');
    header_.is_damaged |= end == bytes.npos;
    at_ += std::min(end, bytes.size()) + 1;
    return bytes.substr(0, end);
  }
  void take_attribute(const std::string& name) {
    const std::string type = word();
    const std::uint64_t size = little(file_.bytes(at_, 4), 0, 4);
    at_ += 4;
    if (at_ > file_.size() || size > file_.size() - at_ || !is_of(type, size))
      header_.is_damaged = true;
    if (header_.is_damaged) return;
    const std::string start = file_.bytes(at_, 16);
    if (name == "dataWindow") take_window(start);
    if (name == "tiles") take_size(little(start, 0, 4), little(start, 4, 4));
    at_ += size;
  }
  bool is_of(std::string_view type, std::uint64_t size) {
    for (const auto& [known, bytes] : kSizes)
      if (type == known) return size == bytes;
    if (type == "chlist") return size <= kMostList && are_channels(file_.bytes(at_, size));
    if (type == "stringvector") return size <= kMostList && are_texts(file_.bytes(at_, size));
    if (type != "preview") return true;
    const std::string sides = file_.bytes(at_, 8);
    return size == 8 + 4 * little(sides, 0, 4) * little(sides, 4, 4);
  }
  /// Each has a name and 16 bytes, which begin with its type: halves take 2 bytes, all others 4.
  bool are_channels(std::string_view list) {
    std::uint64_t bytes = 0;
    std::size_t at = 0;
    while (at < list.size() && list[at] != '\0') {
      at = list.find('\0', at);
      if (at == list.npos) return false;
      bytes += little(list, ++at, 4) == 1 ? 2 : 4;
      at += 16;
    }
    header_.bytes_per_pixel = std::max(header_.bytes_per_pixel, bytes);
    return at + 1 == list.size();
  }
  /// Each is a length and so many bytes.
  static bool are_texts(std::string_view list) {
    std::uint64_t at = 0;
    while (at + 4 <= list.size()) at += 4 + little(list, std::size_t(at), 4);
    return at == list.size();
  }
  void take_window(std::string_view box) {
    const auto side = [&](std::size_t at) {
      const auto corner = [&](std::size_t i) {
        return std::int64_t(std::int32_t(little(box, i, 4)));
      };
      return std::uint64_t(std::max<std::int64_t>(corner(at + 8) - corner(at) + 1, 0));
    };
    take_size(side(0), side(4));
  }
  void take_size(std::uint64_t width, std::uint64_t height) {
    header_.width = std::max(header_.width, width);
    header_.height = std::max(header_.height, height);
  }

  const PictureFile& file_;
  PictureHeader& header_;
  std::uint64_t at_ = 8;
};

}  // namespace

void read_exr_header(const PictureFile& file, PictureHeader& header) { ExrWalk(file, header); }

}  // namespace gs
