// SPDX-License-Identifier: Apache-2.0
// Zip archives with uncompressed entries, as .sog files are. Format: PKWARE's APPNOTE.
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

/// The archive of these entries, in that order. The same entries give the same bytes. Throws Error
/// beyond 4 GiB.
std::string zip_of(const std::vector<ZipEntry>& entries);

/// The entries of an archive in memory, by name; they point into it. Checksums are checked. Throws
/// Error "cannot read PATH: ..." where it is damaged, or where entries are compressed or encrypted.
std::map<std::string, std::string_view> zip_entries(const std::filesystem::path& path,
                                                    std::string_view archive);

}  // namespace gs
