// SPDX-License-Identifier: Apache-2.0
// Three ways through the rows of an element: binary rows of one size (the common case; converted
// column by column, a cache-sized block of rows at a time), binary rows with lists, and lines of
// text.
#include "gs_model/formats/ply/ply_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "gs_core/error.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::size_t kBlockBytes = std::size_t(1) << 17;  // rows and their columns stay in L2

template <class T, bool kSwap>
T load(const std::uint8_t* from) {
  std::uint8_t bytes[sizeof(T)];
  if constexpr (kSwap) {
    std::reverse_copy(from, from + sizeof(T), bytes);
  } else {
    std::memcpy(bytes, from, sizeof(T));
  }
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

// `count` values that lie `row_bytes` apart, into the rows of `column` from `first_row` on.
using ConvertColumn = void (*)(const std::uint8_t* from, std::size_t row_bytes, std::size_t count,
                               const PlyColumn& column, std::size_t first_row);

template <class T, bool kSwap, class To>
void convert_values(const std::uint8_t* from, std::size_t row_bytes, std::size_t count, To* to,
                    std::size_t stride) {
  for (std::size_t i = 0; i < count; ++i) {
    to[i * stride] = static_cast<To>(load<T, kSwap>(from + i * row_bytes));
  }
}

template <class T, bool kSwap>
void convert_column(const std::uint8_t* from, std::size_t row_bytes, std::size_t count,
                    const PlyColumn& column, std::size_t first_row) {
  const std::size_t first = first_row * column.stride + column.offset;
  if (column.doubles)
    convert_values<T, kSwap>(from, row_bytes, count, column.doubles + first, column.stride);
  else
    convert_values<T, kSwap>(from, row_bytes, count, column.array + first, column.stride);
}

template <bool kSwap>
void copy_words(const std::uint8_t* from, std::size_t row_bytes, std::size_t count,
                const PlyColumn& column, std::size_t first_row) {
  float* to = column.array + first_row * column.stride + column.offset;
  for (std::size_t i = 0; i < count; ++i) {
    const auto word = load<std::uint32_t, kSwap>(from + i * row_bytes);
    std::memcpy(to + i * column.stride, &word, sizeof word);
  }
}

template <bool kSwap>
ConvertColumn converter_of(PlyType type) {
  static constexpr ConvertColumn kConverters[] = {
      convert_column<std::int8_t, kSwap>,  convert_column<std::uint8_t, kSwap>,
      convert_column<std::int16_t, kSwap>, convert_column<std::uint16_t, kSwap>,
      convert_column<std::int32_t, kSwap>, convert_column<std::uint32_t, kSwap>,
      convert_column<float, kSwap>,        convert_column<double, kSwap>};
  return kConverters[int(type)];
}

ConvertColumn converter_of(PlyType type, const PlyColumn& column, bool swap) {
  if (column.is_word) return swap ? copy_words<true> : copy_words<false>;
  return swap ? converter_of<true>(type) : converter_of<false>(type);
}

/// Takes a line apart at blanks.
struct Words {
  std::string_view rest;

  std::string_view next() {
    const std::size_t begin = std::min(rest.find_first_not_of(" \t\r"), rest.size());
    const std::size_t end = std::min(rest.find_first_of(" \t\r", begin), rest.size());
    const std::string_view word = rest.substr(begin, end - begin);
    rest.remove_prefix(end);
    return word;
  }
  bool done() const { return rest.find_first_not_of(" \t\r") == rest.npos; }
};

// A word of text as a value of a column; false where it is none.
bool parse_value(std::string_view word, const PlyColumn& column, std::size_t row) {
  if (column.doubles)
    return parse_number(word, column.doubles[row * column.stride + column.offset]);
  float& value = column.array[row * column.stride + column.offset];
  if (!column.is_word) return parse_float(word, value);
  std::uint32_t bits = 0;
  if (!parse_number(word, bits)) return false;
  std::memcpy(&value, &bits, sizeof bits);
  return true;
}

}  // namespace

PlyFile::PlyFile(const std::filesystem::path& path) : reader_(path) {
  const auto length = std::size_t(std::min<std::uint64_t>(reader_.size(), kLongestPlyHeader));
  const auto* beginning = reinterpret_cast<const char*>(reader_.peek(length));
  header_ = parse_ply_header({beginning, length}, path);
  reader_.skip(header_.bytes);
  swap_bytes_ = header_.format == PlyFormat::big_endian;
  line_ = header_.lines;
  check_size();
}

void PlyFile::check_size() const {
  std::uint64_t left = reader_.left();
  for (const PlyElement& element : header_.elements) {
    const std::uint64_t row_bytes = element.row_bytes(header_.format);
    if (row_bytes == 0) continue;
    if (element.count > left / row_bytes) {
      cannot_read(path(),
                  fmt::format("its header promises {} rows of \"{}\" with at least {} bytes each, "
                              "but only {} bytes follow (from byte {}); the file is cut short, "
                              "copy or export it again",
                              element.count, element.name, row_bytes, left, reader_.size() - left));
    }
    left -= element.count * row_bytes;
  }
}

void PlyFile::read_tables(const std::vector<PlyTable>& tables) {
  std::size_t tables_read = 0;
  for (const PlyElement& element : header_.elements) {
    if (tables_read == tables.size()) return;
    Targets targets(element.properties.size(), nullptr);
    for (const PlyTable& table : tables) {
      if (table.element != &element) continue;
      for (const PlyColumn& column : table.columns) {
        const auto property = std::size_t(
            std::find_if(element.properties.begin(), element.properties.end(),
                         [&](const PlyProperty& p) {
                           return p.name == column.property && !!p.count_type == !!column.take_list;
                         }) -
            element.properties.begin());
        GS_CHECK(property < element.properties.size());
        GS_CHECK(!column.is_word || element.properties[property].type == PlyType::uint32);
        targets[property] = &column;
      }
      ++tables_read;
    }
    read_rows(element, targets);
  }
  GS_CHECK(tables_read == tables.size());  // each element is one of the header's
}

void PlyFile::read_rows(const PlyElement& element, const Targets& targets) {
  if (element.properties.empty()) return;
  if (header_.format == PlyFormat::ascii) {
    read_ascii_rows(element, targets);
  } else if (element.has_lists()) {
    read_list_rows(element, targets);
  } else {
    read_fixed_rows(element, targets);
  }
}

void PlyFile::read_fixed_rows(const PlyElement& element, const Targets& targets) {
  struct Field {
    const PlyColumn* column;
    std::size_t offset;  // bytes in the row
    ConvertColumn convert;
  };
  std::vector<Field> fields;
  std::size_t row_bytes = 0;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    const PlyType type = element.properties[i].type;
    if (targets[i])
      fields.push_back({targets[i], row_bytes, converter_of(type, *targets[i], swap_bytes_)});
    row_bytes += size_of(type);
  }
  if (fields.empty()) return reader_.skip(element.count * row_bytes);

  const std::size_t block = std::max<std::size_t>(1, kBlockBytes / row_bytes);
  for (std::size_t row = 0; row < element.count; row += block) {
    const std::size_t count = std::min<std::size_t>(block, element.count - row);
    const std::uint8_t* rows = reader_.take(count * row_bytes);
    for (const Field& field : fields) {
      field.convert(rows + field.offset, row_bytes, count, *field.column, row);
    }
  }
}

void PlyFile::read_list_rows(const PlyElement& element, const Targets& targets) {
  for (std::size_t row = 0; row < element.count; ++row) {
    for (std::size_t i = 0; i < targets.size(); ++i) {
      const PlyProperty& property = element.properties[i];
      if (property.count_type) {
        read_list(property, targets[i]);
      } else if (targets[i]) {
        const std::uint8_t* value = reader_.take(size_of(property.type));
        converter_of(property.type, *targets[i], swap_bytes_)(value, 0, 1, *targets[i], row);
      } else {
        reader_.skip(size_of(property.type));
      }
    }
  }
}

std::uint64_t PlyFile::take_whole(PlyType type) {
  const std::size_t size = size_of(type);
  const std::uint8_t* bytes = reader_.take(size);
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < size; ++i)
    value |= std::uint64_t(bytes[swap_bytes_ ? size - 1 - i : i]) << (8 * i);
  const bool is_signed = type == PlyType::int8 || type == PlyType::int16 || type == PlyType::int32;
  if (is_signed && value >> (8 * size - 1)) value |= ~std::uint64_t(0) << (8 * size - 1);
  return value;
}

void PlyFile::read_list(const PlyProperty& list, const PlyColumn* column) {
  const std::uint64_t position = reader_.position();
  const std::uint64_t count = take_whole(*list.count_type);
  if (count > reader_.left() / size_of(list.type)) {
    cannot_read(path(), fmt::format("the list \"{}\" at byte {} has an impossible length; "
                                    "the file is damaged, copy or export it again",
                                    list.name, position));
  }
  if (!column) return reader_.skip(count * size_of(list.type));
  std::vector<std::uint64_t> values(count);
  for (std::uint64_t& value : values) value = take_whole(list.type);
  column->take_list(values);
}

void PlyFile::read_ascii_rows(const PlyElement& element, const Targets& targets) {
  for (std::uint64_t row = 0; row < element.count; ++row) read_ascii_row(element, targets, row);
}

void PlyFile::read_ascii_row(const PlyElement& element, const Targets& targets, std::uint64_t row) {
  const auto fail = [&](const std::string& what) {
    cannot_read(path(),
                fmt::format("line {} {}; correct that line or export the file again", line_, what));
  };
  Words words;
  while (words.done()) {  // blank lines mean nothing
    const auto line = reader_.take_line();
    ++line_;
    if (!line) {
      cannot_read(path(),
                  fmt::format("it ends in line {}, in row {} of {} of \"{}\"; the file is cut "
                              "short, copy or export it again (if only the last line break is "
                              "missing, add it)",
                              line_, row + 1, element.count, element.name));
    }
    words.rest = *line;
  }
  for (std::size_t i = 0; i < targets.size(); ++i) {
    const PlyProperty& property = element.properties[i];
    std::string_view word = words.next();
    if (word.empty()) fail(fmt::format("has no value for \"{}\"", property.name));
    if (property.count_type) {
      std::uint64_t count = 0;
      if (!parse_number(word, count))
        fail(fmt::format("has \"{}\" as a list's length", word.substr(0, 40)));
      std::vector<std::uint64_t> values;
      for (; count > 0; --count) {
        word = words.next();
        if (word.empty()) fail(fmt::format("ends inside the list \"{}\"", property.name));
        if (!targets[i]) continue;
        if (!parse_number(word, values.emplace_back()))
          fail(fmt::format("has \"{}\" in the list \"{}\"", word.substr(0, 40), property.name));
      }
      if (targets[i]) targets[i]->take_list(values);
    } else if (targets[i]) {
      if (!parse_value(word, *targets[i], row)) {
        fail(fmt::format("has \"{}\" as \"{}\", which is not a number", word.substr(0, 40),
                         property.name));
      }
    }
  }
  if (!words.done()) fail(fmt::format("has more than {} values", targets.size()));
}

}  // namespace gs
