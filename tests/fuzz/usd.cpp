// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians in layers and packages of USD. An input that does not begin as a package is the
// layer in one, too.
#include "gs_model/formats/usd/usd.h"

#include "gs_model/formats/coding/zip_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  takes([&] { read_usd(file_of("model.usda", bytes)); });
  if (bytes.starts_with("PK")) return;
  takes([&] {
    read_usd(file_of("model.usdz", zip_of({{"model.usda", std::string(bytes)}}, false, 64)));
  });
}

const Registered registered{"usd", read};

}  // namespace
}  // namespace gs::fuzz
