// SPDX-License-Identifier: Apache-2.0
// Reads columns of numbers from a PLY file, by name. Types, order and byte order do not matter.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "gs_core/system/byte_reader.h"
#include "gs_model/formats/ply/ply_header.h"

namespace gs {

/// A property and its place in memory: row i belongs to array[i * stride + offset].
struct PlyColumn {
  std::string property;
  float* array = nullptr;
  std::size_t offset = 0, stride = 1;  // floats
  bool is_word = false;  // a property of type uint32 goes bit by bit into the place of each float
  // Of a list of whole numbers, in place of an array: called with those of each row. Numbers below 0
  // are very large ones.
  std::function<void(const std::vector<std::uint64_t>&)> take_list = {};
  double* doubles = nullptr;  // in place of `array`
};

/// The columns to read of an element.
struct PlyTable {
  const PlyElement* element = nullptr;
  std::vector<PlyColumn> columns;
};

/// One PLY file. Order of calls: construct, look at header(), read_columns() or read_tables() once.
/// Every function throws Error, naming the file and the place in it, for a file that is damaged.
class PlyFile {
 public:
  /// Reads the header, and checks that the file is as long as the header promises, so that memory
  /// for `count` rows is no more than a small multiple of the file's size.
  explicit PlyFile(const std::filesystem::path& path);

  const PlyHeader& header() const { return header_; }
  const std::filesystem::path& path() const { return reader_.path(); }
  /// Reads all rows of `element`, one of header(), into the columns; everything else is skipped.
  /// The columns must be properties of it (element.find() >= 0), or lists.
  void read_columns(const PlyElement& element, const std::vector<PlyColumn>& columns) {
    read_tables({{&element, columns}});
  }
  /// The same for several elements, in any order.
  void read_tables(const std::vector<PlyTable>& tables);

 private:
  // The column that a property goes to, or nullptr, in the order of the properties.
  using Targets = std::vector<const PlyColumn*>;

  void check_size() const;
  void read_rows(const PlyElement& element, const Targets& targets);
  void read_fixed_rows(const PlyElement& element, const Targets& targets);
  void read_list_rows(const PlyElement& element, const Targets& targets);
  void read_ascii_rows(const PlyElement& element, const Targets& targets);
  void read_ascii_row(const PlyElement& element, const Targets& targets, std::uint64_t row);
  // A list is read if there is a column for it, else skipped.
  void read_list(const PlyProperty& list, const PlyColumn* column);
  std::uint64_t take_whole(PlyType type);

  ByteReader reader_;
  PlyHeader header_;
  bool swap_bytes_ = false;
  std::uint64_t line_ = 0;  // ascii: the line that was read last, from 1
};

}  // namespace gs
