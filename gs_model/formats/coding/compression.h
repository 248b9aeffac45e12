// SPDX-License-Identifier: Apache-2.0
// gzip, DEFLATE and zstd. In a build without zlib or zstd, the functions throw an Error that names
// what is missing.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace gs {

/// Throw Error that says what to install where this build lacks the library.
void require_zlib();
void require_zstd();

/// A gzip file of one member; the same bytes give the same file.
std::string gzip(std::string_view bytes);
/// The first `bytes` bytes of what a gzip file holds. `is_whole`: there must be no more, and the
/// checksum is checked. Throws Error "cannot read PATH: ..." where it is damaged or holds fewer.
std::string gunzip(const std::filesystem::path& path, std::string_view compressed,
                   std::size_t bytes, bool is_whole);

/// The same without header and checksum: DEFLATE alone (RFC 1951), all of it.
std::string deflate_raw(std::string_view bytes);
std::string inflate_raw(const std::filesystem::path& path, std::string_view compressed,
                        std::size_t bytes);

/// One zstd frame, and the `bytes` bytes that a frame holds; errors as above.
std::string zstd_frame(std::string_view bytes);
std::string unpack_zstd(const std::filesystem::path& path, std::string_view compressed,
                        std::size_t bytes);

}  // namespace gs
