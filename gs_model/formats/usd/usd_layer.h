// SPDX-License-Identifier: Apache-2.0
// A layer of USD in memory, whatever its file is: what the formats of layers share.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "gs_core/system/files/byte_sink.h"

namespace gs {

/// The value of an attribute. Rows of arrays, of vectors and of matrices lie behind each other.
struct UsdValue {
  std::string type;                     // "float3[]", "token", "matrix4d", ...
  std::vector<float> floats = {};       // of floats, halfs and quaternions (w x y z)
  std::vector<double> doubles = {};     // of doubles, matrices, whole numbers and bools
  std::vector<std::string> words = {};  // of tokens and strings
  int element_size = 0;                 // values for each row of the prim; 0: not said
  std::string interpolation = {};       // of a primvar: "vertex", or not said

  bool is_array() const { return type.ends_with("[]"); }
};

struct UsdAttribute {
  std::string name;
  UsdValue value;
  bool is_uniform = false, is_custom = false;
};

struct UsdPrim {
  std::string name, type;
  std::vector<std::string> api_schemas = {};  // prepended
  std::vector<UsdAttribute> attributes = {};
  std::vector<UsdPrim> children = {};

  /// The value of an attribute; null where it has none.
  const UsdValue* find(std::string_view attribute) const {
    for (const UsdAttribute& one : attributes)
      if (one.name == attribute) return &one.value;
    return nullptr;
  }
};

struct UsdLayer {
  std::string up_axis = "Y";
  std::vector<UsdPrim> prims = {};  // the first is the default one
};

enum class UsdNumbers { none, floats, doubles, words };
/// What holds the values of a type.
UsdNumbers usd_numbers(std::string_view type);
/// Numbers in a value of a type, or in a row of its array: 3 of "float3[]", 16 of "matrix4d".
std::size_t usd_width(std::string_view type);

/// The text of a layer, and back. Values of no interest to gemsplat (relationships, dictionaries,
/// metadata) are skipped. Throws Error with the file, the line and a remedy.
void write_usda(ByteSink& sink, const UsdLayer& layer);
UsdLayer parse_usda(const std::filesystem::path& path, std::string_view text);

/// The same as a crate file, and back.
void write_usdc(ByteSink& sink, const UsdLayer& layer);
UsdLayer parse_usdc(const std::filesystem::path& path, std::string_view bytes);

}  // namespace gs
