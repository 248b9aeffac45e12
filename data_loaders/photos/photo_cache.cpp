// SPDX-License-Identifier: Apache-2.0
// An entry: "gsphoto2", width, height, channels (u32 each), its key (40 bytes, zeros behind it), one
// zstd frame, and the XXH3 hash (128 bits) of everything before it; numbers as the machine has them.
// The key tells an entry that was given the name of another one.
#include "data_loaders/photos/photo_cache.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>

#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/log.h"

#ifdef GS_HAVE_PHOTO_CACHE
#include <xxhash.h>
#include <zstd.h>
#endif

namespace gs {

namespace fs = std::filesystem;

namespace {

constexpr const char* kEnding = ".gsphoto";
constexpr std::size_t kHashLength = 32;  // hexadecimal digits of 128 bits
constexpr std::size_t kKeyLength = 40;   // at most: the hash, and letters for the kind of picture

// Whether a file has the form of our names: only such files are ever removed.
bool is_entry(const fs::path& path) {
  const std::string name = path.stem().string();
  return path.extension() == kEnding && name.size() >= kHashLength && name.size() <= kKeyLength &&
         name.find_first_not_of("0123456789abcdef") >= kHashLength &&
         name.find_first_not_of("abcdefghijklmnopqrstuvwxyz", kHashLength) == name.npos &&
         path.parent_path().filename() == name.substr(0, 2);
}

}  // namespace

fs::path usual_photo_cache() {
  const char* cache = std::getenv("XDG_CACHE_HOME");
  if (cache && *cache == '/') return fs::path(cache) / "gemsplat" / "photos";
  const char* home = std::getenv("HOME");
  if (home && *home == '/') return fs::path(home) / ".cache" / "gemsplat" / "photos";
  return {};
}

PhotoCache::PhotoCache(fs::path folder, std::uint64_t most_bytes)
    : folder_(std::move(folder)), most_bytes_(most_bytes),
      opened_(fs::file_time_type::clock::now()) {}

fs::path PhotoCache::path_of(const std::string& key) const {
  return folder_ / key.substr(0, 2) / (key + kEnding);
}

// Lists the entries of the folder, and those that may be removed.
void PhotoCache::take_stock() {
  has_taken_stock_ = true;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder_, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    if (entry.depth() != 1 || !is_entry(entry->path()) || !entry->is_regular_file(ignored))
      continue;
    const std::uint64_t bytes = entry->file_size(ignored);
    if (ignored) continue;
    bytes_ += bytes;
    removable_.push_back({entry->path(), entry->last_write_time(ignored), bytes});
  }
  std::sort(removable_.begin(), removable_.end(),
            [](const OldEntry& a, const OldEntry& b) { return a.used > b.used; });
}

bool PhotoCache::free_bytes_for(std::uint64_t bytes) {
  if (!has_taken_stock_) take_stock();
  while (bytes_ + bytes > most_bytes_ && !removable_.empty()) {
    const OldEntry oldest = removable_.back();
    removable_.pop_back();
    std::error_code error;
    if (fs::last_write_time(oldest.path, error) >= opened_ && !error) continue;  // used meanwhile
    fs::remove(oldest.path, error);
    if (!error) bytes_ -= oldest.bytes;
  }
  return bytes_ + bytes <= most_bytes_;
}

#ifdef GS_HAVE_PHOTO_CACHE

namespace {

constexpr char kMagic[8] = {'g', 's', 'p', 'h', 'o', 't', 'o', '2'};
constexpr std::size_t kBlock = std::size_t(1) << 18;  // bytes read or written at a time
constexpr int kLevel = 1;                             // of zstd

struct Header {
  char magic[8];
  std::uint32_t width, height, channels;
  char key[kKeyLength];
};
static_assert(sizeof(Header) == 20 + kKeyLength);

struct Hash {
  XXH3_state_t* state = XXH3_createState();
  Hash() { XXH3_128bits_reset(state); }
  ~Hash() { XXH3_freeState(state); }
  Hash(const Hash&) = delete;
  Hash& operator=(const Hash&) = delete;
  void add(const void* data, std::size_t bytes) { XXH3_128bits_update(state, data, bytes); }
  XXH128_canonical_t value() const {
    XXH128_canonical_t canonical;
    XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(state));
    return canonical;
  }
};

std::string digits_of(const Hash& hash) {
  std::string digits;
  for (const unsigned char byte : hash.value().digest) digits += fmt::format("{:02x}", byte);
  return digits;
}

// Of an entry of this key and size.
Header header_of(const std::string& key, int width, int height, int channels) {
  GS_CHECK(key.size() <= kKeyLength);
  Header header{{}, std::uint32_t(width), std::uint32_t(height), std::uint32_t(channels), {}};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  std::memcpy(header.key, key.data(), key.size());
  return header;
}

// Pixel by pixel, the difference to the one on the left; and back.
void to_differences(const std::uint8_t* row, std::size_t bytes, std::size_t channels,
                    std::uint8_t* differences) {
  std::copy(row, row + channels, differences);
  for (std::size_t i = channels; i < bytes; ++i)
    differences[i] = std::uint8_t(row[i] - row[i - channels]);
}
void from_differences(std::uint8_t* row, std::size_t bytes, std::size_t channels) {
  for (std::size_t i = channels; i < bytes; ++i) row[i] = std::uint8_t(row[i] + row[i - channels]);
}

// The pixels of an entry whose header was read; false where anything is not as it was written.
bool read_pixels(std::ifstream& file, std::uint64_t compressed_bytes, Hash& hash, Image8& image) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                     ZSTD_freeDCtx);
  std::vector<char> block(kBlock);
  ZSTD_outBuffer out{image.pixels.data(), image.pixels.size(), 0};
  std::size_t left = 1;  // of the frame; 0: complete
  while (compressed_bytes > 0) {
    const std::size_t count = std::size_t(std::min<std::uint64_t>(compressed_bytes, block.size()));
    if (!file.read(block.data(), std::streamsize(count))) return false;
    hash.add(block.data(), count);
    compressed_bytes -= count;
    for (ZSTD_inBuffer in{block.data(), count, 0}; in.pos < in.size;) {
      const std::size_t read_before = in.pos, written_before = out.pos;
      left = ZSTD_decompressStream(context.get(), &out, &in);
      if (ZSTD_isError(left)) return false;
      if (in.pos == read_before && out.pos == written_before) return false;  // more than its size
    }
  }
  if (left != 0 || out.pos != out.size) return false;
  const std::size_t row = std::size_t(image.width) * image.channels;
  for (int y = 0; y < image.height; ++y)
    from_differences(image.pixels.data() + std::size_t(y) * row, row, std::size_t(image.channels));
  return true;
}

std::optional<Image8> read_entry(const fs::path& path, const Header& expected) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return std::nullopt;  // nothing waits for a FIFO
  const std::uint64_t bytes = fs::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  Header header;
  XXH128_canonical_t stored;
  if (error || bytes <= sizeof header + sizeof stored) return std::nullopt;
  if (!file.read(reinterpret_cast<char*>(&header), sizeof header)) return std::nullopt;
  if (std::memcmp(&header, &expected, sizeof header) != 0) return std::nullopt;
  Image8 image(int(header.width), int(header.height), int(header.channels));
  Hash hash;
  hash.add(&header, sizeof header);
  if (!read_pixels(file, bytes - sizeof header - sizeof stored, hash, image)) return std::nullopt;
  if (!file.read(reinterpret_cast<char*>(&stored), sizeof stored)) return std::nullopt;
  const XXH128_canonical_t actual = hash.value();
  if (std::memcmp(&stored, &actual, sizeof stored) != 0) return std::nullopt;
  return image;
}

}  // namespace

bool can_cache_photos() { return true; }

std::string PhotoCache::key_of(const fs::path& path, const std::string& recipe) {
  std::ifstream file(path, std::ios::binary);
  Hash hash;
  std::vector<char> block(kBlock);
  while (file) {
    file.read(block.data(), std::streamsize(block.size()));
    hash.add(block.data(), std::size_t(file.gcount()));
  }
  if (!file.eof()) throw Error("cannot read " + path.string() + "; check the disk and its rights");
  hash.add(recipe.data(), recipe.size());
  return digits_of(hash);
}

std::string PhotoCache::key_of_text(const std::string& text) {
  Hash hash;
  hash.add(text.data(), text.size());
  return digits_of(hash);
}

bool PhotoCache::has(const std::string& key) {
  std::error_code error;
  if (!fs::is_regular_file(path_of(key), error)) return false;
  fs::last_write_time(path_of(key), fs::file_time_type::clock::now(), error);
  return true;
}

std::optional<Image8> PhotoCache::find(const std::string& key, int width, int height,
                                       int channels) {
  const fs::path path = path_of(key);
  std::error_code error;
  if (!fs::exists(path, error)) return std::nullopt;
  std::optional<Image8> image = read_entry(path, header_of(key, width, height, channels));
  if (image)
    fs::last_write_time(path, fs::file_time_type::clock::now(), error);  // used now
  else
    fs::remove(path, error);  // its bytes stay in the count until the next run
  return image;
}

void PhotoCache::store(const std::string& key, const Image8& image) {
  {
    const std::lock_guard lock(mutex_);
    if (is_closed_ || !free_bytes_for(image.pixels.size())) return;
    bytes_ += image.pixels.size();  // until it is known better
  }
  const fs::path path = path_of(key);
  std::uint64_t written = 0;
  try {
    write(key, image);
    std::error_code error;
    written = fs::file_size(path, error);
    if (error) written = 0;
  } catch (const Error& error) {
    const std::lock_guard lock(mutex_);
    if (!is_closed_)
      log_warning("decoded photos are no longer kept on disk: {}", std::string(error.what()));
    is_closed_ = true;
  }
  const std::lock_guard lock(mutex_);
  bytes_ = bytes_ - image.pixels.size() + written;
}

void PhotoCache::write(const std::string& key, const Image8& image) {
  AtomicFile file(path_of(key));
  Hash hash;
  const auto put = [&](const void* data, std::size_t bytes) {
    hash.add(data, bytes);
    file.write(data, bytes);
  };
  const Header header = header_of(key, image.width, image.height, image.channels);
  put(&header, sizeof header);
  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                     ZSTD_freeCCtx);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, kLevel);
  const std::size_t row = std::size_t(image.width) * image.channels;
  std::vector<std::uint8_t> differences(row);
  std::vector<char> block(ZSTD_CStreamOutSize());
  for (int y = 0; y < image.height; ++y) {
    to_differences(image.pixels.data() + std::size_t(y) * row, row, std::size_t(image.channels),
                   differences.data());
    const ZSTD_EndDirective end = y + 1 == image.height ? ZSTD_e_end : ZSTD_e_continue;
    ZSTD_inBuffer in{differences.data(), row, 0};
    for (bool is_done = false; !is_done;) {
      ZSTD_outBuffer out{block.data(), block.size(), 0};
      const std::size_t left = ZSTD_compressStream2(context.get(), &out, &in, end);
      if (ZSTD_isError(left)) throw Error(std::string("zstd: ") + ZSTD_getErrorName(left));
      put(block.data(), out.pos);
      is_done = end == ZSTD_e_end ? left == 0 : in.pos == in.size;
    }
  }
  const XXH128_canonical_t checksum = hash.value();
  file.write(&checksum, sizeof checksum);
  file.commit(AtomicFile::Durability::unsynced);  // the checksum tells of what a power cut left
}

#else

bool can_cache_photos() { return false; }
std::string PhotoCache::key_of(const fs::path&, const std::string&) { return {}; }
std::string PhotoCache::key_of_text(const std::string&) { return {}; }
bool PhotoCache::has(const std::string&) { return false; }
std::optional<Image8> PhotoCache::find(const std::string&, int, int, int) { return std::nullopt; }
void PhotoCache::store(const std::string&, const Image8&) {}
void PhotoCache::write(const std::string&, const Image8&) {}

#endif

}  // namespace gs
