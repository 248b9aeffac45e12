// SPDX-License-Identifier: Apache-2.0
// Entries of the photo cache, which several users may share. Pixels are unpacked before the checksum
// is compared, so the target leaves it as it is.
#include "data_loaders/photos/photo_cache.h"

#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  const std::string key(32, '0');  // make_corpus.cpp stores its entries under this one
  std::filesystem::create_directory(folder() / key.substr(0, 2));
  file_of(key.substr(0, 2) + "/" + key + ".gsphoto", bytes);
  PhotoCache cache(folder(), 1 << 20);
  takes([&] {
    const auto image = cache.find(key, 5, 3, 3);
    require(!image || image->pixels.size() == 5 * 3 * 3, "a picture of another size");
  });
}

const Registered registered{"photo_cache", read};

}  // namespace
}  // namespace gs::fuzz
