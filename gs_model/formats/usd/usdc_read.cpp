// SPDX-License-Identifier: Apache-2.0
// Reads a crate file, of any writer since version 0.7. Values of no interest to gemsplat are left
// out.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <bit>

#include "gs_core/system/byte_reader.h"
#include "gs_model/formats/coding/half.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/usd/crate.h"
#include "gs_model/formats/usd/usd_layer.h"

namespace gs {
namespace {

constexpr std::uint64_t kAlwaysAllowed = 1 << 20;  // numbers in a file of any size
constexpr int kMostParents = 100;

/// Bytes that are taken from the front. Error where there are not enough.
class CrateBytes {
 public:
  CrateBytes(const std::filesystem::path& path, std::string_view bytes)
      : path_(path), bytes_(bytes) {}

  [[noreturn]] void damaged() const {
    cannot_read(path_,
                "as a .usdc it is cut short or damaged; copy or export it again, or let usdcat of "
                "OpenUSD check it");
  }
  std::string_view take(std::uint64_t count) {
    if (count > bytes_.size()) damaged();
    const std::string_view taken = bytes_.substr(0, count);
    bytes_.remove_prefix(count);
    return taken;
  }
  template <class T>
  T take() {
    return load_little<T>(take(sizeof(T)).data());
  }
  CrateBytes part(std::uint64_t begin, std::uint64_t count) const {
    CrateBytes rest = *this;
    rest.take(begin);
    return {path_, rest.take(count)};
  }
  CrateBytes from(std::uint64_t begin) const {
    return part(begin, size() - std::min<std::uint64_t>(begin, size()));
  }
  std::size_t size() const { return bytes_.size(); }

  /// What an LZ4 block behind a byte 0 unpacks to, `most` bytes at most.
  std::string unpack(std::uint64_t packed, std::size_t most) {
    CrateBytes block(path_, take(packed));
    if (block.take<std::uint8_t>() != 0) damaged();  // several blocks: of 2 GB each
    std::string out;
    while (block.size() > 0) {
      const auto code = block.take<std::uint8_t>();
      const auto length = [&](std::size_t count) {
        std::uint8_t more = count == 15 ? 255 : 0;
        while (more == 255) count += more = block.take<std::uint8_t>();
        return count;
      };
      out += block.take(length(code >> 4));
      if (block.size() == 0) break;
      const std::size_t back = block.take<std::uint16_t>(), count = 4 + length(code & 15);
      if (back == 0 || back > out.size() || out.size() + count > most) damaged();
      for (std::size_t i = 0; i < count; ++i) out += out[out.size() - back];
    }
    if (out.size() > most) damaged();
    return out;
  }
  /// Whole numbers behind the size of their block.
  std::vector<std::int32_t> numbers(std::uint64_t count) {
    const std::size_t codes = (2 * count + 7) / 8;
    const auto packed = take<std::uint64_t>();
    const std::string block = unpack(packed, 4 + codes + 4 * count);
    CrateBytes bytes(path_, block);
    const auto common = bytes.take<std::int32_t>();
    const std::string_view code = bytes.take(codes);
    std::vector<std::int32_t> numbers(count);
    std::uint32_t number = 0;
    for (std::size_t i = 0; i < count; ++i) {
      switch (std::uint8_t(code[i / 4]) >> i % 4 * 2 & 3) {
        case 0: number += std::uint32_t(common); break;
        case 1: number += std::uint32_t(bytes.take<std::int8_t>()); break;
        case 2: number += std::uint32_t(bytes.take<std::int16_t>()); break;
        default: number += std::uint32_t(bytes.take<std::int32_t>());
      }
      numbers[i] = std::int32_t(number);
    }
    return numbers;
  }

 private:
  const std::filesystem::path& path_;
  std::string_view bytes_;
};

class CrateReader {
 public:
  CrateReader(const std::filesystem::path& path, std::string_view bytes)
      : file_(path, bytes), most_(kAlwaysAllowed + bytes.size()) {
    CrateBytes header = file_;
    header.take(kCrateMagic.size());
    const int major = header.take<std::uint8_t>(), minor = header.take<std::uint8_t>();
    if (major != 0 || minor < kCrateOldestMinor)
      cannot_read(path, fmt::format("it is a .usdc of version {}.{}, and gemsplat reads 0.{} and "
                                    "later; convert it with `usdcat FILE -o new.usdc`",
                                    major, minor, kCrateOldestMinor));
    header.take(6);
    CrateBytes contents = file_.from(header.take<std::uint64_t>());
    for (auto left = contents.take<std::uint64_t>(); left > 0; --left)
      sections_.push_back(contents.take<CrateSection>());
    read_tables();
  }

  UsdLayer layer() {
    UsdLayer layer;
    std::vector<UsdPrim> prims(paths_.size());
    for (std::size_t s = 0; s < spec_paths_.size(); ++s) {
      const auto path = at(spec_paths_[s], paths_.size());
      const auto kind = CrateSpec(spec_kinds_[s]);
      if (kind == CrateSpec::root) {
        if (const CrateRep* axis = find(s, "upAxis")) layer.up_axis = token_of(*axis);
      } else if (kind == CrateSpec::prim) {
        prims[path].name = paths_[path].name;
        if (const CrateRep* type = find(s, "typeName")) prims[path].type = token_of(*type);
        if (const CrateRep* specifier = find(s, "specifier");
            specifier && specifier->payload() == 2)
          prims[path].type.clear();  // a class is abstract
      } else if (kind == CrateSpec::attribute) {
        add_attribute(s, paths_[path], prims);
      }
    }
    for (std::size_t i = order_.size(); i-- > 0;) {
      const Path& path = paths_[order_[i]];
      if (path.is_property || path.parent < 0) continue;
      std::vector<UsdPrim>& siblings = paths_[std::size_t(path.parent)].parent < 0
                                           ? layer.prims
                                           : prims[std::size_t(path.parent)].children;
      siblings.push_back(std::move(prims[order_[i]]));
    }
    return layer;
  }

 private:
  struct Path {
    std::string name;
    std::int64_t parent = -1;  // of the root
    bool is_property = false;
  };

  [[noreturn]] void damaged() const { file_.damaged(); }
  std::size_t at(std::int64_t index, std::size_t size) const {
    if (index < 0 || std::uint64_t(index) >= size) damaged();
    return std::size_t(index);
  }
  CrateBytes section(std::string_view name) const {
    for (const CrateSection& section : sections_)
      if (std::string_view(section.name, strnlen(section.name, sizeof section.name)) == name)
        return file_.part(std::uint64_t(section.begin), std::uint64_t(section.size));
    damaged();
  }
  /// A count, which is not more than a file of this size holds in all.
  std::uint64_t counted(std::uint64_t count) {
    if (count > most_) damaged();
    most_ -= count;
    return count;
  }

  void read_tables() {
    CrateBytes tokens = section("TOKENS");
    const auto count = counted(tokens.take<std::uint64_t>());
    const auto bytes = counted(tokens.take<std::uint64_t>());
    const auto packed = tokens.take<std::uint64_t>();
    const std::string text = tokens.unpack(packed, bytes);
    for (std::size_t begin = 0; begin < text.size() && tokens_.size() < count;) {
      const std::size_t end = std::min(text.find('\0', begin), text.size());
      tokens_.push_back(text.substr(begin, end - begin));
      begin = end + 1;
    }
    CrateBytes fields = section("FIELDS");
    const auto field_count = counted(fields.take<std::uint64_t>());
    field_names_ = fields.numbers(field_count);
    const auto packed_reps = fields.take<std::uint64_t>();
    const std::string reps = fields.unpack(packed_reps, 8 * field_count);
    if (reps.size() != 8 * field_count) damaged();
    for (std::size_t i = 0; i < field_count; ++i)
      reps_.push_back({load_little<std::uint64_t>(&reps[8 * i])});
    CrateBytes sets = section("FIELDSETS");
    const auto set_count = counted(sets.take<std::uint64_t>());
    field_sets_ = sets.numbers(set_count);
    CrateBytes specs = section("SPECS");
    const auto spec_count = counted(specs.take<std::uint64_t>());
    for (auto* numbers : {&spec_paths_, &spec_fields_, &spec_kinds_})
      *numbers = specs.numbers(spec_count);
    read_paths();
  }
  void read_paths() {
    CrateBytes bytes = section("PATHS");
    paths_.resize(counted(bytes.take<std::uint64_t>()));
    const auto count = counted(bytes.take<std::uint64_t>());
    const std::vector<std::int32_t> indices = bytes.numbers(count), names = bytes.numbers(count),
                                    jumps = bytes.numbers(count);
    // Of each path that still has a sibling to come: where that stands, and the parent of both.
    std::vector<std::pair<std::size_t, std::int64_t>> siblings;
    std::int64_t parent = -1;
    for (std::size_t i = 0; i < count; ++i) {
      if (!siblings.empty() && siblings.back().first == i) {
        parent = siblings.back().second;
        siblings.pop_back();
      }
      const std::size_t index = at(indices[i], paths_.size());
      Path& path = paths_[index];
      if ((parent < 0) != (i == 0) || !path.name.empty() || std::int64_t(index) == parent)
        damaged();
      path = {i == 0 ? "/" : tokens_[at(std::abs(std::int64_t(names[i])), tokens_.size())], parent,
              names[i] < 0};
      int parents = 0;
      for (std::int64_t above = parent; above >= 0; above = paths_[std::size_t(above)].parent)
        if (++parents > kMostParents) damaged();
      order_.push_back(index);
      const bool has_child = jumps[i] > 0 || jumps[i] == -1;
      if (jumps[i] > 0) siblings.push_back({i + std::size_t(jumps[i]), parent});
      if (has_child) parent = std::int64_t(index);
    }
  }

  const CrateRep* find(std::size_t spec, std::string_view name) const {
    for (std::size_t i = at(spec_fields_[spec], field_sets_.size());
         i < field_sets_.size() && field_sets_[i] >= 0; ++i) {
      const std::size_t field = at(field_sets_[i], reps_.size());
      if (tokens_[at(field_names_[field], tokens_.size())] == name) return &reps_[field];
    }
    return nullptr;
  }
  const std::string& token_of(CrateRep rep) const {
    if (rep.type() != CrateType::token || !rep.is(CrateRep::kInlined)) damaged();
    return tokens_[at(std::int64_t(rep.payload()), tokens_.size())];
  }

  void add_attribute(std::size_t spec, const Path& path, std::vector<UsdPrim>& prims) {
    const CrateRep *type = find(spec, "typeName"), *value = find(spec, "default");
    if (!path.is_property || path.parent < 0) damaged();
    std::vector<UsdAttribute>& attributes = prims[std::size_t(path.parent)].attributes;
    if (find(spec, "timeSamples")) attributes.push_back({path.name + ".timeSamples", {}});
    if (!type || !value) return;
    UsdAttribute attribute{path.name, {token_of(*type)}};
    if (take_value(*value, attribute.value)) attributes.push_back(std::move(attribute));
  }
  /// False for values of no interest.
  bool take_value(CrateRep rep, UsdValue& value) {
    const bool is_array = rep.is(CrateRep::kArray), is_inlined = rep.is(CrateRep::kInlined);
    const CrateType type = rep.type();
    const auto low = std::uint32_t(rep.payload());
    if (type == CrateType::token) {
      if (!is_array) {
        value.words = {token_of(rep)};
      } else if (rep.payload() != 0) {
        CrateBytes bytes = file_.from(rep.payload());
        for (auto left = counted(bytes.take<std::uint64_t>()); left > 0; --left)
          value.words.push_back(tokens_[at(bytes.take<std::uint32_t>(), tokens_.size())]);
      }
      return true;
    }
    if (!is_array && is_inlined) {
      switch (type) {
        case CrateType::boolean:
        case CrateType::int32: value.doubles = {double(std::int32_t(low))}; return true;
        case CrateType::float32: value.floats = {std::bit_cast<float>(low)}; return true;
        case CrateType::float64: value.doubles = {std::bit_cast<float>(low)}; return true;
        case CrateType::half: value.floats = {from_half(std::uint16_t(low))}; return true;
        case CrateType::vec3f:
        case CrateType::vec3d:  // whole numbers of a byte each
          for (int i = 0; i < 3; ++i) value.doubles.push_back(std::int8_t(low >> 8 * i));
          return true;
        case CrateType::matrix4d:  // its diagonal
          for (int i = 0; i < 16; ++i)
            value.doubles.push_back(i % 5 ? 0 : std::int8_t(low >> i / 5 * 8));
          return true;
        default: return false;
      }
    }
    switch (type) {
      case CrateType::int32: return take_rows<std::int32_t>(rep, value.doubles, 1);
      case CrateType::float32: return take_rows<float>(rep, value.floats, 1);
      case CrateType::half: return take_rows<std::uint16_t>(rep, value.floats, 1);
      case CrateType::vec2f: return take_rows<float>(rep, value.floats, 2);
      case CrateType::vec3f: return take_rows<float>(rep, value.floats, 3);
      case CrateType::vec3h: return take_rows<std::uint16_t>(rep, value.floats, 3);
      case CrateType::quatf: return take_rows<float>(rep, value.floats, 4);
      case CrateType::quath: return take_rows<std::uint16_t>(rep, value.floats, 4);
      case CrateType::quatd: return take_rows<double>(rep, value.doubles, 4);
      case CrateType::float64: return take_rows<double>(rep, value.doubles, 1);
      case CrateType::vec3d: return take_rows<double>(rep, value.doubles, 3);
      case CrateType::matrix4d: return take_rows<double>(rep, value.doubles, 16);
      default: return false;
    }
  }
  template <class Stored, class T>
  bool take_rows(CrateRep rep, std::vector<T>& values, std::size_t width) {
    const auto number = [](Stored stored) -> T {
      if constexpr (std::is_same_v<Stored, std::uint16_t>)
        return from_half(stored);
      else
        return stored;
    };
    const bool is_array = rep.is(CrateRep::kArray);
    if (is_array && rep.payload() == 0) return true;  // an empty one
    CrateBytes bytes = file_.from(rep.payload());
    const auto rows = counted(is_array ? bytes.take<std::uint64_t>() : 1);
    if (is_array && rep.is(CrateRep::kCompressed)) {  // single numbers: whole ones, or of a table
      if constexpr (std::is_same_v<Stored, std::int32_t>) {
        for (const std::int32_t whole : bytes.numbers(rows)) values.push_back(T(whole));
        return true;
      }
      std::vector<Stored> table;
      const auto code = bytes.take<char>();
      if (code == 't') {
        table.resize(counted(bytes.take<std::uint32_t>()));
        for (Stored& entry : table) entry = bytes.take<Stored>();
      }
      if (width != 1 || (code != 't' && code != 'i')) damaged();
      for (const std::int32_t whole : bytes.numbers(rows))
        values.push_back(code == 'i' ? T(whole) : number(table[at(whole, table.size())]));
      return true;
    }
    CrateBytes numbers(bytes);
    counted(rows * width);
    const std::string_view raw = numbers.take(rows * width * sizeof(Stored));
    values.resize(rows * width);
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = number(load_little<Stored>(&raw[i * sizeof(Stored)]));
    if (width == 4)  // x y z w
      for (std::size_t i = 0; i < values.size(); i += 4)
        std::rotate(&values[i], &values[i] + 3, &values[i] + 4);
    return true;
  }

  CrateBytes file_;
  std::uint64_t most_;
  std::vector<CrateSection> sections_;
  std::vector<std::string> tokens_;
  std::vector<std::int32_t> field_names_, field_sets_, spec_paths_, spec_fields_, spec_kinds_;
  std::vector<CrateRep> reps_;
  std::vector<Path> paths_;
  std::vector<std::size_t> order_;  // of paths, parents first
};

}  // namespace

UsdLayer parse_usdc(const std::filesystem::path& path, std::string_view bytes) {
  return CrateReader(path, bytes).layer();
}

}  // namespace gs
