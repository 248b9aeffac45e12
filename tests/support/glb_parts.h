// SPDX-License-Identifier: Apache-2.0
// The two parts of a .glb, to be changed and put together again.
#pragma once

#include <string>

#include "gs_core/system/text/json.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/glb/glb.h"

namespace gs {

struct GlbParts {
  Json json;
  std::string binary;
};

inline GlbParts glb_parts(const std::string& file) {
  const auto json_bytes = load_little<std::uint32_t>(&file[12]);
  return {Json::parse(file.substr(20, json_bytes)), file.substr(20 + json_bytes + 8)};
}

/// A .glb with this text as its JSON, whatever it is.
inline std::string glb_file_of(std::string json, std::string binary) {
  binary.resize((binary.size() + 3) / 4 * 4, '\0');
  return glb_head(std::move(json), binary.size()) + binary;
}
inline std::string glb_file_of(const GlbParts& parts) {
  return glb_file_of(parts.json.dump(), parts.binary);
}

}  // namespace gs
