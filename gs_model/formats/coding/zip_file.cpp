// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/coding/zip_file.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/crc32.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_model/formats/coding/little_endian.h"

namespace gs {
namespace {

#pragma pack(push, 1)
/// What both headers of an entry hold.
struct EntryFields {
  std::uint16_t version_needed = 20, flags = 0, method = 0;  // method 0: stored
  std::uint16_t time = 0, date = 0x21;                       // 1 January 1980
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

constexpr std::uint16_t kEncrypted = 1;
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

}  // namespace

std::string zip_of(const std::vector<ZipEntry>& entries) {
  std::string archive, directory;
  for (const ZipEntry& entry : entries) {
    LocalHeader local;
    local.fields.crc = crc32_of(entry.bytes);
    local.fields.packed_bytes = local.fields.bytes = std::uint32_t(entry.bytes.size());
    local.fields.name_bytes = std::uint16_t(entry.name.size());
    CentralHeader central;
    central.fields = local.fields;
    central.local_offset = std::uint32_t(archive.size());
    append_little(archive, local);
    archive += entry.name + entry.bytes;
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
    throw Error("a zip archive, which .sog is, cannot have more than 4 GiB; choose .ply or .spz");
  return archive;
}

std::map<std::string, std::string_view> zip_entries(const std::filesystem::path& path,
                                                    std::string_view bytes) {
  const ArchiveReader archive(path, bytes);
  const EndRecord end = archive.end();
  std::map<std::string, std::string_view> entries;
  std::uint64_t at = end.central_offset, total = 0;
  for (int i = 0; i < end.entries; ++i) {
    const auto central = archive.load<CentralHeader>(at);
    const EntryFields& fields = central.fields;
    const std::string name(archive.part(at + sizeof central, fields.name_bytes));
    const std::string shown = shown_word(name);
    at += sizeof central + fields.name_bytes + fields.extra_bytes + central.comment_bytes;
    if (fields.method != 0 || fields.flags & kEncrypted)
      cannot_read(path, fmt::format("{} in it is compressed or encrypted, but .sog stores its "
                                    "files as they are; export it again",
                                    shown));
    const auto local = archive.load<LocalHeader>(central.local_offset);
    const std::string_view content =
        archive.part(std::uint64_t(central.local_offset) + sizeof local + local.fields.name_bytes +
                         local.fields.extra_bytes,
                     fields.bytes);
    total += content.size();
    if (total > bytes.size()) archive.damaged();  // entries that overlap
    if (crc32_of(content) != fields.crc)
      cannot_read(path, fmt::format("the checksum of {} in it does not match; the file is damaged, "
                                    "copy or export it again",
                                    shown));
    entries[name] = content;
  }
  return entries;
}

}  // namespace gs
