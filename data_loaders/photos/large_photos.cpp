// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/large_photos.h"

#include <spdlog/fmt/fmt.h>

namespace gs {

std::string note_on_reduced_photos(const PhotoSize& largest, const PhotoSize& reduced) {
  return fmt::format("photos of {}x{} are trained at {}x{}; -r 1 keeps all of their pixels",
                     largest.width, largest.height, reduced.width, reduced.height);
}

}  // namespace gs
