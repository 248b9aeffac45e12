// SPDX-License-Identifier: Apache-2.0
// Models with levels of detail. An input that begins with { is a lod-meta.json, and behind a mark
// the meta.json of the SOG folder 0_0, whose pictures the target writes; other inputs are a .rad.
#include "gs_model/formats/lod/rad.h"
#include "gs_model/formats/lod/streamed_sog.h"
#include "gs_model/formats/sog/sog.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/random_model.h"

namespace gs::fuzz {
namespace {

/// A folder whose pictures fit the seed: SOG of ten Gaussians.
const std::filesystem::path& scene() {
  static const std::filesystem::path scene = [] {
    const std::filesystem::path path = folder() / "lod";
    takes([&] { write_sog_folder(path / "0_0", random_model(10, 1)); });
    std::filesystem::create_directories(path / "0_0");  // also in a build without libwebp
    return path;
  }();
  return scene;
}

void read_folder(std::string_view bytes) {
  const std::string name = (scene() / kLodMeta).lexically_relative(folder()).string();
  const std::size_t end = bytes.find(kNextFile);
  const std::filesystem::path meta = file_of(name, bytes.substr(0, end));
  if (end != bytes.npos) file_of("lod/0_0/meta.json", bytes.substr(end + kNextFile.size()));
  for (const int level : {0, 2}) takes([&] { read_streamed_sog(meta, level); });
}

void read(std::string_view bytes) {
  if (bytes.starts_with('{')) return read_folder(bytes);
  takes([&] { read_rad(file_of("model.rad", bytes)); });
}

const Registered registered{"lod", read};

}  // namespace
}  // namespace gs::fuzz
