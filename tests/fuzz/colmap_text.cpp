// SPDX-License-Identifier: Apache-2.0
// A COLMAP model in text, whose files stand one behind the other in an input; and COLMAP's log, which
// quotes names of photos.
#include "data_loaders/reconstruct/colmap_log.h"
#include "tests/fuzz/colmap_folder.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  std::filesystem::create_directory(folder() / "text");
  write_files(bytes, {"text/cameras.txt", "text/images.txt", "text/points3D.txt", "text/rigs.txt",
                      "text/frames.txt"});
  read_colmap_folder(folder() / "text");
  const std::filesystem::path log = file_of("colmap.log", bytes);
  takes([&] {
    read_colmap_log(log);
    for (std::string_view rest = bytes; !rest.empty();) {
      const std::size_t end = std::min(rest.find('\n'), rest.size() - 1);
      colmap_count(rest.substr(0, end));
      rest.remove_prefix(end + 1);
    }
  });
}

const Registered registered{"colmap_text", read};

}  // namespace
}  // namespace gs::fuzz
