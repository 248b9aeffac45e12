// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/coding/compression.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"

#ifdef GS_HAVE_ZLIB
#include <zlib.h>
#endif
#ifdef GS_HAVE_ZSTD
#include <zstd.h>
#endif

namespace gs {
namespace {

[[maybe_unused]] constexpr int kGzip = 15 + 16;  // zlib: a window of 2^15 bytes, gzip's header
[[maybe_unused]] constexpr const char* kOfZlib = "a .spz, .rad or .npz file";
[[maybe_unused]] constexpr int kRaw = -15;       // the same window without header and checksum
[[maybe_unused]] constexpr int kZstdLevel = 12;  // higher ones are slower and hardly smaller
[[maybe_unused]] constexpr std::size_t kMostUnpacked = 1032;  // bytes from one, by deflate
[[maybe_unused]] constexpr std::size_t kFirstUnpacked = std::size_t(1) << 20;  // bytes
[[maybe_unused]] constexpr std::size_t kZlibRoom = std::size_t(1) << 30;  // zlib counts in 32 bits

[[maybe_unused]] [[noreturn]] void fail_without(const char* library, const char* package,
                                                const char* formats) {
  throw Error(
      fmt::format("this build has no {}, which {} needs; install {}, run `cmake --fresh "
                  "--preset default` and build again, or choose another format",
                  library, formats, package));
}

[[maybe_unused]] [[noreturn]] void damaged(const std::filesystem::path& path) {
  cannot_read(path, "its packed data is cut short or damaged; copy or export it again");
}

}  // namespace

#ifdef GS_HAVE_ZLIB

namespace {

std::string packed_by_zlib(std::string_view bytes, int format) {
  z_stream stream{};
  GS_CHECK(deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, format, 9, Z_DEFAULT_STRATEGY) ==
           Z_OK);
  std::string packed;
  std::size_t taken = 0;
  int state = Z_OK;
  while (state == Z_OK || state == Z_BUF_ERROR) {
    if (stream.avail_in == 0 && taken < bytes.size()) {
      const std::size_t some = std::min(kZlibRoom, bytes.size() - taken);
      stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data() + taken));
      stream.avail_in = uInt(some);
      taken += some;
    }
    const std::size_t done = packed.size();
    packed.resize(done + std::max<std::size_t>(1 << 16, done / 2));
    const std::size_t room = std::min(kZlibRoom, packed.size() - done);
    stream.next_out = reinterpret_cast<Bytef*>(packed.data() + done);
    stream.avail_out = uInt(room);
    state = deflate(&stream, taken == bytes.size() ? Z_FINISH : Z_NO_FLUSH);
    packed.resize(done + room - stream.avail_out);
  }
  deflateEnd(&stream);
  GS_CHECK(state == Z_STREAM_END);
  return packed;
}

std::string unpacked_by_zlib(const std::filesystem::path& path, std::string_view compressed,
                             std::size_t bytes, bool is_whole, int format) {
  if (bytes / kMostUnpacked > compressed.size()) damaged(path);
  z_stream stream{};
  GS_CHECK(inflateInit2(&stream, format) == Z_OK);
  const struct End {  // also where memory runs out
    z_stream& stream;
    ~End() { inflateEnd(&stream); }
  } end{stream};
  std::string unpacked;
  std::size_t taken = 0, done = 0;
  int state = Z_OK;
  while (state == Z_OK && done < bytes) {
    // It grows with what the file really holds: a short file may promise anything.
    if (done == unpacked.size())
      unpacked.resize(std::min(bytes, std::max(kFirstUnpacked, 2 * done)));
    const std::size_t some = std::min(kZlibRoom, compressed.size() - taken);
    const std::size_t room = std::min(kZlibRoom, unpacked.size() - done);
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(compressed.data() + taken));
    stream.avail_in = uInt(some);
    stream.next_out = reinterpret_cast<Bytef*>(unpacked.data() + done);
    stream.avail_out = uInt(room);
    state = inflate(&stream, Z_NO_FLUSH);
    taken += some - stream.avail_in;
    done += room - stream.avail_out;
  }
  if (is_whole && state == Z_OK) {  // the checksum
    Bytef beyond[1];
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(compressed.data() + taken));
    stream.avail_in = uInt(std::min(kZlibRoom, compressed.size() - taken));
    stream.next_out = beyond;
    stream.avail_out = sizeof beyond;
    state = inflate(&stream, Z_FINISH);
  }
  if (done < bytes || state == Z_DATA_ERROR || (is_whole && state != Z_STREAM_END)) damaged(path);
  return unpacked;
}

}  // namespace

void require_zlib() {}
std::string gzip(std::string_view bytes) { return packed_by_zlib(bytes, kGzip); }
std::string gunzip(const std::filesystem::path& path, std::string_view compressed,
                   std::size_t bytes, bool is_whole) {
  return unpacked_by_zlib(path, compressed, bytes, is_whole, kGzip);
}
std::string deflate_raw(std::string_view bytes) { return packed_by_zlib(bytes, kRaw); }
std::string inflate_raw(const std::filesystem::path& path, std::string_view compressed,
                        std::size_t bytes) {
  return unpacked_by_zlib(path, compressed, bytes, true, kRaw);
}

#else

void require_zlib() { fail_without("zlib", "zlib1g-dev", kOfZlib); }
std::string gzip(std::string_view) { fail_without("zlib", "zlib1g-dev", kOfZlib); }
std::string gunzip(const std::filesystem::path&, std::string_view, std::size_t, bool) {
  fail_without("zlib", "zlib1g-dev", kOfZlib);
}
std::string deflate_raw(std::string_view) { fail_without("zlib", "zlib1g-dev", kOfZlib); }
std::string inflate_raw(const std::filesystem::path&, std::string_view, std::size_t) {
  fail_without("zlib", "zlib1g-dev", kOfZlib);
}

#endif
#ifdef GS_HAVE_ZSTD

void require_zstd() {}

std::string zstd_frame(std::string_view bytes) {
  std::string packed(ZSTD_compressBound(bytes.size()), '\0');
  const std::size_t size =
      ZSTD_compress(packed.data(), packed.size(), bytes.data(), bytes.size(), kZstdLevel);
  if (ZSTD_isError(size))
    throw Error(fmt::format("zstd cannot compress: {}", ZSTD_getErrorName(size)),
                ExitCode::out_of_memory);
  packed.resize(size);
  return packed;
}

std::string unpack_zstd(const std::filesystem::path& path, std::string_view compressed,
                        std::size_t bytes) {
  const unsigned long long promised =
      ZSTD_getFrameContentSize(compressed.data(), compressed.size());
  if (promised == ZSTD_CONTENTSIZE_ERROR ||
      (promised != ZSTD_CONTENTSIZE_UNKNOWN && promised != bytes))
    damaged(path);
  // A frame that is cut short is refused before memory is asked for.
  if (ZSTD_isError(ZSTD_findFrameCompressedSize(compressed.data(), compressed.size())))
    damaged(path);
  std::string unpacked(bytes, '\0');
  const std::size_t size =
      ZSTD_decompress(unpacked.data(), bytes, compressed.data(), compressed.size());
  if (ZSTD_isError(size) || size != bytes) damaged(path);
  return unpacked;
}

#else

void require_zstd() { fail_without("zstd", "libzstd-dev", ".spz"); }
std::string zstd_frame(std::string_view) { fail_without("zstd", "libzstd-dev", ".spz"); }
std::string unpack_zstd(const std::filesystem::path&, std::string_view, std::size_t) {
  fail_without("zstd", "libzstd-dev", ".spz");
}

#endif

}  // namespace gs
