// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/coding/zip_file.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/crc32.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/little_endian.h"

namespace gs {
namespace {

#pragma pack(push, 1)
/// What both headers of an entry hold.
struct EntryFields {
  std::uint16_t version_needed = 20, flags = 0, method = 0;
  std::uint16_t time = 0, date = 0x21;  // 1 January 1980
  std::uint32_t crc = 0, packed_bytes = 0, bytes = 0;
  std::uint16_t name_bytes = 0, extra_bytes = 0;
};
struct LocalHeader {
  std::uint32_t magic = 0x04034b50;
  EntryFields fields;
};
struct CentralHeader {
  std::uint32_t magic = 0x02014b50;
  std::uint16_t version_made = 20;
  EntryFields fields;
  std::uint16_t comment_bytes = 0, disk = 0, internal_attributes = 0;
  std::uint32_t external_attributes = 0, local_offset = 0;
};
struct EndRecord {
  std::uint32_t magic = 0x06054b50;
  std::uint16_t disk = 0, central_disk = 0, disk_entries = 0, entries = 0;
  std::uint32_t central_bytes = 0, central_offset = 0;
  std::uint16_t comment_bytes = 0;
};
#pragma pack(pop)
static_assert(sizeof(LocalHeader) == 30 && sizeof(CentralHeader) == 46 && sizeof(EndRecord) == 22);

constexpr std::uint16_t kEncrypted = 1, kStored = 0, kDeflated = 8;
constexpr std::uint16_t kPaddingField = 0x1986;  // as OpenUSD numbers it in .usdz
constexpr std::size_t kLongestComment = 0xffff;
constexpr std::uint64_t kLargestArchive = 0xffffffff;

/// A part of the archive; Error where it does not lie inside.
class ArchiveReader {
 public:
  ArchiveReader(const std::filesystem::path& path, std::string_view bytes)
      : path_(path), bytes_(bytes) {}

  std::string_view part(std::uint64_t offset, std::uint64_t length) const {
    if (offset > bytes_.size() || length > bytes_.size() - offset) damaged();
    return bytes_.substr(offset, length);
  }
  template <class T>
  T load(std::uint64_t offset) const {
    const auto value = load_little<T>(part(offset, sizeof(T)).data());
    if (value.magic != T{}.magic) damaged();
    return value;
  }
  /// The last record, behind which there is but a comment.
  EndRecord end() const {
    if (bytes_.size() < sizeof(EndRecord)) damaged();
    const std::size_t last = bytes_.size() - sizeof(EndRecord);
    for (std::size_t back = 0; back <= std::min(last, kLongestComment); ++back) {
      const auto record = load_little<EndRecord>(bytes_.data() + last - back);
      if (record.magic == EndRecord{}.magic && record.comment_bytes == back) return record;
    }
    damaged();
  }
  [[noreturn]] void damaged() const {
    cannot_read(path_,
                "it is not a complete zip archive; the file is cut short or damaged, copy or "
                "export it again");
  }

 private:
  const std::filesystem::path& path_;
  std::string_view bytes_;
};

/// A field of a header that makes what begins behind `at` bytes begin at a multiple of `alignment`.
std::string padding_for(std::size_t at, std::size_t alignment) {
  std::size_t bytes = (alignment - at % alignment) % alignment;
  if (bytes == 0) return {};
  if (bytes < 4) bytes += alignment;  // a field has a number and a size of 16 bits each
  std::string field;
  append_little(field, kPaddingField);
  append_little(field, std::uint16_t(bytes - 4));
  return field + std::string(bytes - 4, '\0');
}

void check_crc(const std::filesystem::path& path, const std::string& name, std::string_view bytes,
               std::uint32_t crc) {
  if (crc32_of(bytes) != crc)
    cannot_read(path, fmt::format("the checksum of {} in it does not match; the file is damaged, "
                                  "copy or export it again",
                                  shown_word(name)));
}

}  // namespace

std::string zip_of(const std::vector<ZipEntry>& entries, bool deflated, std::size_t alignment) {
  std::string archive, directory, packed;
  for (const ZipEntry& entry : entries) {
    if (deflated) packed = deflate_raw(entry.bytes);
    const std::string& content = deflated ? packed : entry.bytes;
    LocalHeader local;
    local.fields.method = deflated ? kDeflated : kStored;
    local.fields.crc = crc32_of(entry.bytes);
    local.fields.packed_bytes = std::uint32_t(content.size());
    local.fields.bytes = std::uint32_t(entry.bytes.size());
    local.fields.name_bytes = std::uint16_t(entry.name.size());
    CentralHeader central;
    central.fields = local.fields;
    central.local_offset = std::uint32_t(archive.size());
    const std::string padding =
        padding_for(archive.size() + sizeof local + entry.name.size(), alignment);
    local.fields.extra_bytes = std::uint16_t(padding.size());
    append_little(archive, local);
    archive += entry.name;
    archive += padding;
    archive += content;
    append_little(directory, central);
    directory += entry.name;
  }
  EndRecord end;
  end.disk_entries = end.entries = std::uint16_t(entries.size());
  end.central_bytes = std::uint32_t(directory.size());
  end.central_offset = std::uint32_t(archive.size());
  archive += directory;
  append_little(archive, end);
  if (archive.size() > kLargestArchive)
    throw Error(
        "a zip archive, which .sog, .npz and .usdz are, cannot have more than 4 GiB; choose .ply");
  return archive;
}

std::map<std::string, PackedEntry> packed_entries(const std::filesystem::path& path,
                                                  std::string_view bytes) {
  const ArchiveReader archive(path, bytes);
  const EndRecord end = archive.end();
  std::map<std::string, PackedEntry> entries;
  std::uint64_t at = end.central_offset, total = 0;
  for (int i = 0; i < end.entries; ++i) {
    const auto central = archive.load<CentralHeader>(at);
    const EntryFields& fields = central.fields;
    const std::string name(archive.part(at + sizeof central, fields.name_bytes));
    at += sizeof central + fields.name_bytes + fields.extra_bytes + central.comment_bytes;
    if ((fields.method != kStored && fields.method != kDeflated) || fields.flags & kEncrypted)
      cannot_read(path, fmt::format("{} in it is encrypted, or compressed in a way that only some "
                                    "programs know; export it again",
                                    shown_word(name)));
    const auto local = archive.load<LocalHeader>(central.local_offset);
    const std::string_view content =
        archive.part(std::uint64_t(central.local_offset) + sizeof local + local.fields.name_bytes +
                         local.fields.extra_bytes,
                     fields.packed_bytes);
    const bool is_deflated = fields.method == kDeflated;
    total += content.size();
    if (total > bytes.size() || (!is_deflated && fields.bytes != content.size()))
      archive.damaged();  // entries that overlap, or have two sizes
    entries[name] = {content, fields.bytes, fields.crc, is_deflated};
  }
  return entries;
}

std::string unpacked(const std::filesystem::path& path, const std::string& name,
                     const PackedEntry& entry) {
  const std::string bytes =
      entry.is_deflated ? inflate_raw(path, entry.packed, entry.bytes) : std::string(entry.packed);
  check_crc(path, name, bytes, entry.crc);
  return bytes;
}

std::map<std::string, std::string_view> zip_entries(const std::filesystem::path& path,
                                                    std::string_view archive) {
  std::map<std::string, std::string_view> entries;
  for (const auto& [name, entry] : packed_entries(path, archive)) {
    if (entry.is_deflated)
      cannot_read(path, fmt::format("{} in it is compressed, but .sog stores its files as they "
                                    "are; export it again",
                                    shown_word(name)));
    check_crc(path, name, entry.packed, entry.crc);
    entries[name] = entry.packed;
  }
  return entries;
}

}  // namespace gs
