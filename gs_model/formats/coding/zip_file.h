// SPDX-License-Identifier: Apache-2.0
// Zip archives with entries that are stored, as in .sog files, or deflated, as in .npz files.
// Format: PKWARE's APPNOTE.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

struct ZipEntry {
  std::string name, bytes;
};

/// The archive of these entries, in that order, which may be deflated. What each holds begins at a
/// multiple of `alignment` bytes, 64 at most. The same entries give the same bytes. Throws Error
/// beyond 4 GiB.
std::string zip_of(const std::vector<ZipEntry>& entries, bool deflated = false,
                   std::size_t alignment = 1);

/// An entry as it lies in an archive.
struct PackedEntry {
  std::string_view packed;
  std::uint32_t bytes, crc;  // of what it holds
  bool is_deflated;
};
/// The entries of an archive in memory, by name; they point into it. Throws Error "cannot read PATH:
/// ..." where it is damaged, or where entries are encrypted or compressed otherwise than by DEFLATE.
std::map<std::string, PackedEntry> packed_entries(const std::filesystem::path& path,
                                                  std::string_view archive);
/// What an entry holds; the caller has looked at how much that is. The checksum is checked. Throws
/// Error as above.
std::string unpacked(const std::filesystem::path& path, const std::string& name,
                     const PackedEntry& entry);

/// The entries of an archive without compression. Checksums are checked. Throws Error as above, and
/// where entries are compressed.
std::map<std::string, std::string_view> zip_entries(const std::filesystem::path& path,
                                                    std::string_view archive);

}  // namespace gs
