// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as extreme_saving.zip. An input is a file, or # and then its arrays, each after a
// line with its name, which the target packs twice, so that no checksum refuses them.
#include "gs_model/formats/npz/vectree.h"

#include "gs_model/formats/coding/zip_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

std::string packed_twice(std::string_view arrays) {
  std::vector<ZipEntry> entries;
  while (!arrays.empty()) {
    const std::size_t end = arrays.find(kNextFile);
    const std::string_view array = arrays.substr(0, end);
    const std::size_t line = std::min(array.find('\n'), array.size());
    entries.push_back(
        {std::string(array.substr(0, line)),
         zip_of({{"arr_0.npy", std::string(array.substr(std::min(line + 1, array.size())))}},
                true)});
    if (end == arrays.npos) break;
    arrays.remove_prefix(end + kNextFile.size());
  }
  return zip_of(entries, true);
}

void read_twice_packed(std::string_view bytes) {
  const bool is_unpacked = bytes.starts_with('#');
  takes([&] {
    read_vectree(is_unpacked ? file_of("model.zip", packed_twice(bytes.substr(1)))
                             : file_of("model.zip", bytes));
  });
}

const Registered registered_vectree{"vectree", read_twice_packed};

}  // namespace
}  // namespace gs::fuzz
