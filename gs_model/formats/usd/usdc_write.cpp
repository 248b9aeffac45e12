// SPDX-License-Identifier: Apache-2.0
// A layer as a crate file. Nothing is compressed: tables are as long as they can be, and small beside
// the values.
#include <bit>
#include <map>

#include "gs_core/error.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/usd/crate.h"
#include "gs_model/formats/usd/usd_layer.h"

namespace gs {
namespace {

using Tokens = std::vector<std::string>;

/// Bytes as an LZ4 block of one run of literals, behind the number of further blocks.
std::string as_block(const std::string& bytes) {
  std::string block(1, '\0');
  std::size_t left = bytes.size();
  block += char(std::min<std::size_t>(left, 15) << 4);
  if (left >= 15) {
    for (left -= 15; left >= 255; left -= 255) block += '\xff';
    block += char(left);
  }
  return block + bytes;
}

template <class T>
void append_sized(std::string& to, const T& block) {
  append_little(to, std::uint64_t(block.size()));
  to += block;
}

/// Whole numbers as differences of 4 bytes.
void append_numbers(std::string& to, const std::vector<std::int32_t>& numbers) {
  std::string bytes;
  append_little(bytes, std::int32_t(0));  // the most common difference, which none refers to
  std::string codes((numbers.size() * 2 + 7) / 8, '\xff');
  if (numbers.size() % 4 != 0) codes.back() = char((1 << numbers.size() % 4 * 2) - 1);
  bytes += codes;
  std::uint32_t before = 0;
  for (const std::int32_t number : numbers) {
    append_little(bytes, std::uint32_t(number) - before);
    before = std::uint32_t(number);
  }
  append_sized(to, as_block(bytes));
}

class CrateWriter {
 public:
  explicit CrateWriter(const UsdLayer& layer) : layer_(layer) {
    token(";-)");  // the names of properties are negative, so that none may be 0
    add_root();
  }

  void write(ByteSink& sink) {
    const std::string sections = all_sections();
    std::string header(kCrateMagic);
    append_little(header, std::uint64_t(kCrateMinor) << 8);
    append_little(header, contents_);
    header.resize(kCrateHeaderBytes);
    sink.write(header);
    for (const Chunk& chunk : chunks_) {
      sink.write(chunk.head);
      sink.write(chunk.data, chunk.bytes);
      sink.write(std::string((8 - (chunk.head.size() + chunk.bytes) % 8) % 8, '\0'));
    }
    sink.write(sections);
  }

 private:
  /// A value: bytes of its own, then some of the layer.
  struct Chunk {
    std::string head;
    const void* data = nullptr;
    std::size_t bytes = 0;
  };

  std::int32_t token(const std::string& text) {
    const auto [found, is_new] = token_indices_.try_emplace(text, std::int32_t(tokens_.size()));
    if (is_new) tokens_.push_back(text);
    return found->second;
  }
  static CrateRep inlined(CrateType type, std::uint32_t payload) {
    return {CrateRep::kInlined | std::uint64_t(type) << 48 | payload};
  }
  CrateRep token_rep(const std::string& text) {
    return inlined(CrateType::token, std::uint32_t(token(text)));
  }
  CrateRep stored(CrateType type, Chunk chunk, std::uint64_t flags = 0) {
    const CrateRep rep{flags | std::uint64_t(type) << 48 | values_end_};
    values_end_ += (chunk.head.size() + chunk.bytes + 7) / 8 * 8;
    chunks_.push_back(std::move(chunk));
    return rep;
  }
  CrateRep tokens_rep(CrateType type, const Tokens& words, std::string head = {},
                      std::uint64_t flags = 0) {
    append_little(head, std::uint64_t(words.size()));
    for (const std::string& word : words) append_little(head, token(word));
    return stored(type, {std::move(head)}, flags);
  }
  CrateRep float_array(const UsdValue& value) {
    const std::size_t width = usd_width(value.type);
    Chunk chunk;
    append_little(chunk.head, std::uint64_t(value.floats.size() / width));
    if (width == 4) {  // x y z w
      for (std::size_t i = 0; i < value.floats.size(); i += 4)
        for (const std::size_t at : {1, 2, 3, 0}) append_little(chunk.head, value.floats[i + at]);
    } else {
      chunk.data = value.floats.data();
      chunk.bytes = value.floats.size() * sizeof(float);
    }
    const CrateType type = width == 4   ? CrateType::quatf
                           : width == 3 ? CrateType::vec3f
                           : width == 2 ? CrateType::vec2f
                                        : CrateType::float32;
    return stored(type, std::move(chunk), CrateRep::kArray);
  }
  CrateRep int_array(const UsdValue& value) {
    std::string bytes;
    bytes.reserve(8 + 4 * value.doubles.size());
    append_little(bytes, std::uint64_t(value.doubles.size()));
    for (const double number : value.doubles) append_little(bytes, std::int32_t(number));
    return stored(CrateType::int32, {std::move(bytes)}, CrateRep::kArray);
  }
  CrateRep rep_of(const UsdValue& value) {
    const std::string& type = value.type;
    if (type == "token") return token_rep(value.words.at(0));
    if (type == "token[]") return tokens_rep(CrateType::token, value.words, {}, CrateRep::kArray);
    if (type == "int[]") return int_array(value);
    if (value.is_array()) return float_array(value);
    if (type == "float")
      return inlined(CrateType::float32, std::bit_cast<std::uint32_t>(value.floats.at(0)));
    if (type == "int") return inlined(CrateType::int32, std::uint32_t(value.doubles.at(0)));
    if (type == "bool") return inlined(CrateType::boolean, std::uint32_t(value.doubles.at(0)));
    if (type == "float2")
      return stored(CrateType::vec2f, {{}, value.floats.data(), 2 * sizeof(float)});
    GS_CHECK(type == "double3" || type == "matrix4d");
    return stored(type == "double3" ? CrateType::vec3d : CrateType::matrix4d,
                  {{}, value.doubles.data(), value.doubles.size() * sizeof(double)});
  }

  void field(const std::string& name, CrateRep rep) {
    field_sets_.push_back(std::int32_t(fields_.size()));
    fields_.push_back(token(name));
    append_little(reps_, rep.bits);
  }
  void begin_spec(CrateSpec kind, std::int32_t name) {
    spec_fields_.push_back(std::int32_t(field_sets_.size()));
    spec_kinds_.push_back(std::int32_t(kind));
    names_.push_back(name);
    jumps_.push_back(0);
  }
  void end_spec() { field_sets_.push_back(-1); }

  static Tokens names_of(const auto& members) {
    Tokens names;
    for (const auto& member : members) names.push_back(member.name);
    return names;
  }
  void add_root() {
    begin_spec(CrateSpec::root, token(""));
    field("defaultPrim", token_rep(layer_.prims.at(0).name));
    field("metersPerUnit", inlined(CrateType::float64, std::bit_cast<std::uint32_t>(1.0f)));
    field("upAxis", token_rep(layer_.up_axis));
    field("primChildren", tokens_rep(CrateType::token_vector, names_of(layer_.prims)));
    end_spec();
    jumps_[0] = -1;
    for (const UsdPrim& prim : layer_.prims) add_prim(prim, &prim == &layer_.prims.back());
  }
  void add_prim(const UsdPrim& prim, bool is_last) {
    const std::size_t index = jumps_.size();
    begin_spec(CrateSpec::prim, token(prim.name));
    field("specifier", inlined(CrateType::specifier, 0));  // def
    field("typeName", token_rep(prim.type));
    if (!prim.api_schemas.empty())
      field("apiSchemas",
            tokens_rep(CrateType::token_list_op, prim.api_schemas, {'\x20'}));  // prepended
    if (!prim.attributes.empty())
      field("properties", tokens_rep(CrateType::token_vector, names_of(prim.attributes)));
    if (!prim.children.empty())
      field("primChildren", tokens_rep(CrateType::token_vector, names_of(prim.children)));
    end_spec();
    for (const UsdAttribute& attribute : prim.attributes)
      add_attribute(attribute, prim.children.empty() && &attribute == &prim.attributes.back());
    for (const UsdPrim& child : prim.children) add_prim(child, &child == &prim.children.back());
    const auto members = std::int32_t(jumps_.size() - index);  // with itself
    jumps_[index] = members == 1 ? (is_last ? -2 : 0) : is_last ? -1 : members;
  }
  void add_attribute(const UsdAttribute& attribute, bool is_last) {
    begin_spec(CrateSpec::attribute, -token(attribute.name));
    field("typeName", token_rep(attribute.value.type));
    if (attribute.is_custom) field("custom", inlined(CrateType::boolean, 1));
    if (attribute.is_uniform) field("variability", inlined(CrateType::variability, 1));
    field("default", rep_of(attribute.value));
    if (attribute.value.element_size > 0)
      field("elementSize", inlined(CrateType::int32, std::uint32_t(attribute.value.element_size)));
    if (!attribute.value.interpolation.empty())
      field("interpolation", token_rep(attribute.value.interpolation));
    end_spec();
    jumps_.back() = is_last ? -2 : 0;
  }

  /// The sections and the table of contents, as they stand behind the values.
  std::string all_sections() {
    std::string bytes, table;
    std::uint64_t count = 0;
    const auto add = [&](std::string_view name, const std::string& section) {
      CrateSection entry{
          {}, std::int64_t(values_end_ + bytes.size()), std::int64_t(section.size())};
      name.copy(entry.name, sizeof entry.name);
      append_little(table, entry);
      bytes += section;
      ++count;
    };
    const auto sized = [](std::size_t size) {
      std::string section;
      append_little(section, std::uint64_t(size));
      return section;
    };
    std::string text, section = sized(tokens_.size());
    for (const std::string& word : tokens_) text += word + '\0';
    append_little(section, std::uint64_t(text.size()));
    append_sized(section, as_block(text));
    add("TOKENS", section);
    add("STRINGS", sized(0));
    section = sized(fields_.size());
    append_numbers(section, fields_);
    append_sized(section, as_block(reps_));
    add("FIELDS", section);
    section = sized(field_sets_.size());
    append_numbers(section, field_sets_);
    add("FIELDSETS", section);
    std::vector<std::int32_t> paths(names_.size());
    for (std::size_t i = 0; i < paths.size(); ++i) paths[i] = std::int32_t(i);
    section = sized(paths.size()) + sized(paths.size());
    for (const auto& numbers : {paths, names_, jumps_}) append_numbers(section, numbers);
    add("PATHS", section);
    section = sized(paths.size());
    for (const auto& numbers : {paths, spec_fields_, spec_kinds_}) append_numbers(section, numbers);
    add("SPECS", section);
    contents_ = values_end_ + bytes.size();
    return bytes + sized(count) + table;
  }

  const UsdLayer& layer_;
  std::map<std::string, std::int32_t> token_indices_;
  Tokens tokens_;
  std::vector<Chunk> chunks_;
  std::uint64_t values_end_ = kCrateHeaderBytes, contents_ = 0;
  std::vector<std::int32_t> fields_, field_sets_, names_, jumps_, spec_fields_, spec_kinds_;
  std::string reps_;
};

}  // namespace

void write_usdc(ByteSink& sink, const UsdLayer& layer) { CrateWriter(layer).write(sink); }

}  // namespace gs
