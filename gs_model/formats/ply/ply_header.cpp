// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/ply/ply_header.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <set>

#include "gs_core/system/byte_reader.h"

namespace gs {
namespace {

std::optional<PlyType> type_named(std::string_view name) {
  static const std::map<std::string_view, PlyType> kTypes{
      {"char", PlyType::int8},      {"int8", PlyType::int8},       {"uchar", PlyType::uint8},
      {"uint8", PlyType::uint8},    {"short", PlyType::int16},     {"int16", PlyType::int16},
      {"ushort", PlyType::uint16},  {"uint16", PlyType::uint16},   {"int", PlyType::int32},
      {"int32", PlyType::int32},    {"uint", PlyType::uint32},     {"uint32", PlyType::uint32},
      {"float", PlyType::float32},  {"float32", PlyType::float32}, {"double", PlyType::float64},
      {"float64", PlyType::float64}};
  const auto found = kTypes.find(name);
  return found == kTypes.end() ? std::nullopt : std::optional(found->second);
}

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  for (std::size_t at = 0; (at = line.find_first_not_of(" \t", at)) != line.npos;) {
    const std::size_t end = std::min(line.find_first_of(" \t", at), line.size());
    words.push_back(line.substr(at, end - at));
    at = end;
  }
  return words;
}

/// Takes the header line by line; knows the line for error messages.
class HeaderParser {
 public:
  HeaderParser(std::string_view text, const std::filesystem::path& path)
      : text_(text), path_(path) {}

  PlyHeader parse() {
    if (text_.empty()) cannot_read(path_, "the file is empty; copy or export it again");
    if (text_.substr(0, 3) != "ply" || next_line() != "ply") {
      cannot_read(path_, "this is not a PLY file (it does not begin with a line \"ply\")");
    }
    bool has_format = false;
    for (;;) {
      const std::string_view line = next_line();
      const auto words = words_of(line);
      if (words.empty() || words[0] == "obj_info") continue;
      if (words[0] == "end_header") break;
      if (words[0] == "comment") {
        header_.comments.emplace_back(words.size() > 1 ? line.substr(words[1].data() - line.data())
                                                       : std::string_view());
      } else if (words[0] == "format") {
        parse_format(words);
        has_format = true;
      } else if (words[0] == "element") {
        parse_element(words);
      } else if (words[0] == "property") {
        parse_property(words);
      } else {
        fail(fmt::format("\"{}\" begins no line of a PLY header", words[0].substr(0, 40)));
      }
    }
    if (!has_format) fail("the header has no format line");
    header_.bytes = at_;
    return std::move(header_);
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    cannot_read(path_, fmt::format("{}, in line {}; export the file again", what, header_.lines));
  }

  std::string_view next_line() {
    const std::size_t end = text_.find('\n', at_);
    if (end == text_.npos) {
      cannot_read(path_, fmt::format("its header has no end (no line \"end_header\") in the first "
                                     "{} bytes; copy or export the file again",
                                     text_.size()));
    }
    std::string_view line = text_.substr(at_, end - at_);
    at_ = end + 1;
    ++header_.lines;
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    return line;
  }

  void parse_format(const std::vector<std::string_view>& words) {
    const std::string_view name = words.size() == 3 && words[2] == "1.0" ? words[1] : "";
    if (name == "ascii") {
      header_.format = PlyFormat::ascii;
    } else if (name == "binary_little_endian") {
      header_.format = PlyFormat::little_endian;
    } else if (name == "binary_big_endian") {
      header_.format = PlyFormat::big_endian;
    } else {
      fail("the format is not ascii, binary_little_endian or binary_big_endian of version 1.0");
    }
  }

  void parse_element(const std::vector<std::string_view>& words) {
    if (words.size() != 3) fail("an element needs a name and a count");
    PlyElement element{std::string(words[1]), 0, {}};
    const char* end = words[2].data() + words[2].size();
    const auto [rest, error] = std::from_chars(words[2].data(), end, element.count);
    if (error != std::errc() || rest != end) {
      fail(fmt::format("\"{}\" is not a count of rows", words[2].substr(0, 40)));
    }
    header_.elements.push_back(std::move(element));
    names_.clear();
  }

  void parse_property(const std::vector<std::string_view>& words) {
    if (header_.elements.empty()) fail("a property stands before the first element");
    const bool is_list = words.size() == 5 && words[1] == "list";
    if (!is_list && words.size() != 3) fail("a property needs a type and a name");
    PlyProperty property;
    property.name = words.back();
    property.type = parse_type(words[words.size() - 2]);
    if (is_list) property.count_type = parse_type(words[2]);
    if (is_list && *property.count_type >= PlyType::float32)
      fail("the length of a list is not an integer");
    if (!names_.insert(property.name).second) {
      fail(fmt::format("the property {} occurs twice", property.name));
    }
    header_.elements.back().properties.push_back(std::move(property));
  }

  PlyType parse_type(std::string_view name) const {
    const auto type = type_named(name);
    if (!type) fail(fmt::format("\"{}\" is not a type of a property", name.substr(0, 40)));
    return *type;
  }

  std::string_view text_;
  const std::filesystem::path& path_;
  std::size_t at_ = 0;
  std::set<std::string> names_;  // of the properties of the last element
  PlyHeader header_;
};

}  // namespace

std::size_t size_of(PlyType type) {
  static constexpr std::size_t kSizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[int(type)];
}

bool PlyElement::has_lists() const {
  return std::any_of(properties.begin(), properties.end(),
                     [](const PlyProperty& property) { return property.count_type.has_value(); });
}

int PlyElement::find(std::string_view property) const {
  for (std::size_t i = 0; i < properties.size(); ++i) {
    if (properties[i].name == property && !properties[i].count_type) return int(i);
  }
  return -1;
}

std::uint64_t PlyElement::row_bytes(PlyFormat format) const {
  if (format == PlyFormat::ascii) return 2 * properties.size();  // a digit and a space each
  std::uint64_t bytes = 0;
  for (const PlyProperty& property : properties) {
    bytes += size_of(property.count_type.value_or(property.type));
  }
  return bytes;
}

const PlyElement* PlyHeader::find(std::string_view element) const {
  for (const PlyElement& candidate : elements) {
    if (candidate.name == element) return &candidate;
  }
  return nullptr;
}

PlyHeader parse_ply_header(std::string_view beginning, const std::filesystem::path& path) {
  return HeaderParser(beginning, path).parse();
}

}  // namespace gs
