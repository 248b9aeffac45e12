// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as extreme_saving.zip. An input is a file, or # and then its arrays, each after a
// line with its name, which the target packs twice, so that no checksum refuses them.
#include "gs_model/formats/npz/vectree.h"

#include "tests/fuzz/named_arrays.h"

namespace gs::fuzz {
namespace {

std::string packed_twice(std::string_view arrays) {
  std::vector<ZipEntry> files = named_arrays(arrays);
  for (ZipEntry& file : files) file.bytes = zip_of({{"arr_0.npy", file.bytes}}, true);
  return zip_of(files, true);
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
