// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as .npz. An input is a file, or # and then the arrays of one, each after a line
// with its name, which the target packs as zip, so that no checksum refuses them.
#include "gs_model/formats/npz/npz.h"

#include "tests/fuzz/named_arrays.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  const bool is_unpacked = bytes.starts_with('#');
  takes([&] {
    read_npz(is_unpacked ? file_of("model.npz", zip_of(named_arrays(bytes.substr(1)), true))
                         : file_of("model.npz", bytes));
  });
}

const Registered registered{"npz", read};

}  // namespace
}  // namespace gs::fuzz
