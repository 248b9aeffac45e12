// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as .spz. An input is a file, or # and then the unpacked data of one (a header and
// the arrays), which the target packs, so that neither zlib nor zstd refuses it.
#include "gs_model/formats/spz/spz.h"

#include <algorithm>

#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/spz/spz_layout.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

template <class T>
void append(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// Version 4: header, table of streams, and a zstd frame for each array.
std::string with_streams(SpzHeader header, std::string_view arrays) {
  const auto row_bytes = spz_row_bytes(header.version, std::min<int>(header.sh_degree, 4));
  std::string table, frames;
  header.last = 0;
  for (const std::size_t row : row_bytes) {
    const std::string_view array = arrays.substr(0, row * std::min(header.count, 1000u));
    arrays.remove_prefix(array.size());
    if (array.empty()) continue;
    const std::string frame = zstd_frame(array);
    append(table, SpzStream{frame.size(), array.size()});
    frames += frame;
    ++header.last;
  }
  std::string file;
  append(file, header);
  append(file, SpzStreamTable{});
  return file + table + frames;
}

std::string packed(std::string_view unpacked) {
  if (unpacked.size() < kSpzHeaderBytes) return gzip(unpacked);
  const auto header = load_little<SpzHeader>(unpacked.data());
  return header.version == 4 ? with_streams(header, unpacked.substr(kSpzHeaderBytes))
                             : gzip(unpacked);
}

void read(std::string_view bytes) {
  const bool is_unpacked = bytes.starts_with('#');
  takes([&] {
    read_spz(is_unpacked ? file_of("model.spz", packed(bytes.substr(1)))
                         : file_of("model.spz", bytes));
  });
}

const Registered registered{"spz", read};

}  // namespace
}  // namespace gs::fuzz
