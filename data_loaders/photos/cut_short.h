// SPDX-License-Identifier: Apache-2.0
// Photos whose end is missing, as after a copy that was interrupted.
#pragma once

#include <filesystem>

namespace gs {

/// Whether a JPEG, PNG, WebP or HEIF ends before its last part, or a file is empty. It follows the
/// lengths and marks in the file, and of large JPEGs looks at the end only, so it is much faster
/// than decoding. False for other formats, and for what is damaged in another way. Throws
/// AccessError.
bool is_cut_short(const std::filesystem::path& photo);

}  // namespace gs
