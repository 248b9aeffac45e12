// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as .npz. An input is a file, or # and then the arrays of one, each after a line
// with its name, which the target packs as zip, so that no checksum refuses them.
#include "gs_model/formats/npz/npz.h"

#include "gs_model/formats/coding/zip_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

std::string packed(std::string_view arrays) {
  std::vector<ZipEntry> entries;
  while (!arrays.empty()) {
    const std::size_t end = arrays.find(kNextFile);
    const std::string_view array = arrays.substr(0, end);
    const std::size_t line = std::min(array.find('\n'), array.size());
    entries.push_back({std::string(array.substr(0, line)),
                       std::string(array.substr(std::min(line + 1, array.size())))});
    if (end == arrays.npos) break;
    arrays.remove_prefix(end + kNextFile.size());
  }
  return zip_of(entries, true);
}

void read(std::string_view bytes) {
  const bool is_unpacked = bytes.starts_with('#');
  takes([&] {
    read_npz(is_unpacked ? file_of("model.npz", packed(bytes.substr(1)))
                         : file_of("model.npz", bytes));
  });
}

const Registered registered{"npz", read};

}  // namespace
}  // namespace gs::fuzz
