// SPDX-License-Identifier: Apache-2.0
// The text of a layer.
#include <spdlog/fmt/fmt.h>

#include <iterator>

#include "gs_core/system/version.h"
#include "gs_model/formats/usd/usd_layer.h"

namespace gs {
namespace {

constexpr std::size_t kBytesPerWrite = 1 << 20;

/// Gathers text, so that a large array is in memory once.
class UsdaText {
 public:
  explicit UsdaText(ByteSink& sink) : sink_(sink) {}
  ~UsdaText() = default;

  template <class... Args>
  void add(fmt::format_string<Args...> format, Args&&... args) {
    fmt::format_to(std::back_inserter(text_), format, std::forward<Args>(args)...);
    if (text_.size() > kBytesPerWrite) flush();
  }
  void flush() {
    sink_.write(text_);
    text_.clear();
  }

 private:
  ByteSink& sink_;
  std::string text_;
};

/// Numbers from `first` on as (a, b, c), or as one; those of a matrix as its rows.
template <class T>
void add_row(UsdaText& text, const T* first, std::size_t width) {
  if (width == 1) return text.add("{}", *first);
  text.add("(");
  for (std::size_t i = 0; i < width; i += width == 16 ? 4 : 1) {
    if (i > 0) text.add(", ");
    add_row(text, first + i, width == 16 ? 4 : 1);
  }
  text.add(")");
}

template <class T>
void add_rows(UsdaText& text, const std::vector<T>& numbers, const UsdValue& value) {
  const std::size_t width = usd_width(value.type);
  if (value.is_array()) text.add("[");
  for (std::size_t i = 0; i < numbers.size(); i += width) {
    if (i > 0) text.add(", ");
    add_row(text, &numbers[i], width);
  }
  if (value.is_array()) text.add("]");
}

std::string words_text(const UsdValue& value) {
  std::string text;
  for (const std::string& word : value.words) text += (text.empty() ? "\"" : ", \"") + word + "\"";
  return value.is_array() ? "[" + text + "]" : text;
}

void add_attribute(UsdaText& text, const UsdAttribute& attribute, const std::string& indent) {
  const UsdValue& value = attribute.value;
  text.add("{}{}{}{} {} = ", indent, attribute.is_custom ? "custom " : "",
           attribute.is_uniform ? "uniform " : "", value.type, attribute.name);
  switch (usd_numbers(value.type)) {
    case UsdNumbers::floats: add_rows(text, value.floats, value); break;
    case UsdNumbers::doubles: add_rows(text, value.doubles, value); break;
    default: text.add("{}", words_text(value));
  }
  if (value.element_size > 0)
    text.add(" (\n{0}    elementSize = {1}\n{0})", indent, value.element_size);
  if (!value.interpolation.empty())
    text.add(" (\n{0}    interpolation = \"{1}\"\n{0})", indent, value.interpolation);
  text.add("\n");
}

void add_prim(UsdaText& text, const UsdPrim& prim, const std::string& indent) {
  text.add("\n{}def {} \"{}\"", indent, prim.type, prim.name);
  if (!prim.api_schemas.empty()) {
    const UsdValue schemas{"token[]", {}, {}, prim.api_schemas};
    text.add(" (\n{0}    prepend apiSchemas = {1}\n{0})", indent, words_text(schemas));
  }
  text.add("\n{}{{\n", indent);
  for (const UsdAttribute& attribute : prim.attributes)
    add_attribute(text, attribute, indent + "    ");
  for (const UsdPrim& child : prim.children) add_prim(text, child, indent + "    ");
  text.add("{}}}\n", indent);
}

}  // namespace

void write_usda(ByteSink& sink, const UsdLayer& layer) {
  UsdaText text(sink);
  text.add(
      "#usda 1.0\n(\n    defaultPrim = \"{}\"\n    doc = \"gemsplat {}\"\n    metersPerUnit = 1\n"
      "    upAxis = \"{}\"\n)\n",
      layer.prims.at(0).name, kVersion, layer.up_axis);
  for (const UsdPrim& prim : layer.prims) add_prim(text, prim, "");
  text.flush();
}

}  // namespace gs
