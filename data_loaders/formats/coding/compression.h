// SPDX-License-Identifier: Apache-2.0
// gzip and zstd, where this build has zlib and zstd. All functions throw Error that says what is missing where it has not.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace gs {

/// Throw Error that says what to install where this build lacks them.
void require_zlib();
void require_zstd();

/// A gzip file of one member; the same bytes give the same file.
std::string gzip(std::string_view bytes);
/// The first `bytes` bytes of what a gzip file holds; all of them where `is_whole`, with its checksum. Throws Error "cannot
/// read PATH: ..." where it is damaged or holds fewer.
std::string gunzip(const std::filesystem::path& path, std::string_view compressed,
                   std::size_t bytes, bool is_whole);

/// One zstd frame, and what one of `bytes` bytes held; errors as above.
std::string zstd_frame(std::string_view bytes);
std::string unpack_zstd(const std::filesystem::path& path, std::string_view compressed,
                        std::size_t bytes);

}  // namespace gs
