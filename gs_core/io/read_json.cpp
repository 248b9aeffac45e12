// SPDX-License-Identifier: Apache-2.0
#include "gs_core/io/read_json.h"

#include <fstream>

#include "gs_core/error.h"

namespace gs {

nlohmann::ordered_json read_json(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw Error("cannot read " + path.string() + ": there is no such file");
  nlohmann::ordered_json json = nlohmann::ordered_json::parse(file, nullptr, false);
  if (!json.is_object())
    throw Error("cannot read " + path.string() +
                ": it is damaged; move it away to continue without it, or train again");
  return json;
}

}  // namespace gs
