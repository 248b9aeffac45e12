// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as .ksplat. An input is a file, or # and then, without the zeros between them,
// what its headers say: a byte for the number of sections, the first 44 bytes of the file, the
// first
// 42 of each section, and the data.
#include "gs_model/formats/ksplat.h"

#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

constexpr std::size_t kMostSections = 7;

std::string unpacked(std::string_view parts) {
  const auto take = [&](std::size_t count) {
    const std::string_view part = parts.substr(0, count);
    parts.remove_prefix(part.size());
    return std::string(part);
  };
  const std::size_t sections = parts.empty() ? 0 : std::uint8_t(take(1)[0]) & kMostSections;
  std::string file = take(44);
  file.resize(4096);
  for (std::size_t s = 0; s < sections; ++s) {
    file += take(42);
    file.resize(4096 + 1024 * (s + 1));
  }
  return file.append(parts);
}

void read(std::string_view bytes) {
  takes([&] {
    read_ksplat(bytes.starts_with('#') ? file_of("model.ksplat", unpacked(bytes.substr(1)))
                                       : file_of("model.ksplat", bytes));
  });
}

const Registered registered{"ksplat", read};

}  // namespace
}  // namespace gs::fuzz
