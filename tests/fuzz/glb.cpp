// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians in a .glb. An input that begins with { is its JSON and, behind a mark, its
// binary chunk, which the target puts together; other inputs are a file.
#include "gs_model/formats/glb/glb.h"

#include "tests/fuzz/fuzz_target.h"
#include "tests/support/glb_parts.h"

namespace gs::fuzz {
namespace {

std::string packed(std::string_view parts) {
  const std::size_t end = parts.find(kNextFile);
  const std::string_view binary =
      end == parts.npos ? std::string_view() : parts.substr(end + kNextFile.size());
  return glb_file_of(std::string(parts.substr(0, end)), std::string(binary));
}

void read(std::string_view bytes) {
  takes([&] {
    read_glb(bytes.starts_with('{') ? file_of("model.glb", packed(bytes))
                                    : file_of("model.glb", bytes));
  });
}

const Registered registered{"glb", read};

}  // namespace
}  // namespace gs::fuzz
