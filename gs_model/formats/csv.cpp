// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/csv.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "gs_core/geometry/world_offset.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/parse_number.h"
#include "gs_model/formats/ply/ply_layout.h"

namespace gs {
namespace {

constexpr std::size_t kWriteBytes = std::size_t(1) << 20;  // at a time
constexpr std::size_t kLongestNumber = 32;                 // characters
constexpr double kMostLost = 1e-6;  // of the model's spread, by positions as floats

std::string_view without_blanks(std::string_view word) {
  const std::size_t begin = std::min(word.find_first_not_of(" \t\r\""), word.size());
  const std::size_t end = word.find_last_not_of(" \t\r\"");
  return word.substr(begin, end == word.npos ? 0 : end + 1 - begin);
}

// Hands out the fields of a line one by one.
struct Fields {
  std::string_view rest;
  bool done = false;

  std::string_view next() {
    const std::size_t comma = rest.find(',');
    const std::string_view field = rest.substr(0, comma);
    done = comma == rest.npos;
    rest.remove_prefix(done ? rest.size() : comma + 1);
    return without_blanks(field);
  }
};

/// Hands out the lines of a text, the last one with or without its line feed; blank lines are
/// skipped.
class Lines {
 public:
  explicit Lines(const std::filesystem::path& path) : reader_(path) {}
  const std::filesystem::path& path() const { return reader_.path(); }
  std::size_t number() const { return number_; }

  bool next(std::string_view& line) {
    do {
      if (reader_.left() == 0) return false;
      if (const auto whole = reader_.take_line()) {
        line = *whole;
      } else {
        const std::size_t left = reader_.left();
        line = {reinterpret_cast<const char*>(reader_.take(left)), left};
      }
      ++number_;
    } while (without_blanks(line).empty());
    return true;
  }

 private:
  ByteReader reader_;
  std::size_t number_ = 0;
};

PlyElement columns_of(std::string_view line) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (line.starts_with(kByteOrderMark)) line.remove_prefix(kByteOrderMark.size());
  PlyElement element;
  for (Fields fields{line}; !fields.done;)
    element.properties.push_back({std::string(fields.next()), PlyType::float32, {}});
  return element;
}

// For each field of a line, the column of `columns` that it belongs to; -1: none.
std::vector<int> targets_of(const PlyElement& table, const std::vector<PlyColumn>& columns,
                            const std::filesystem::path& path) {
  std::vector<std::string> missing;
  std::vector<int> targets(table.properties.size(), -1);
  for (std::size_t c = 0; c < columns.size(); ++c) {
    const int at = table.find(columns[c].property);
    if (at < 0)
      missing.push_back(columns[c].property);
    else
      targets[at] = int(c);
  }
  if (!missing.empty())
    cannot_read(path, fmt::format("its first line lacks the columns {}; export the table again "
                                  "with all of them",
                                  list_of(missing)));
  return targets;
}

/// The rows as they are read. x y z are the first three columns of gaussian_columns().
struct Rows {
  std::size_t width;
  std::vector<float> values;     // (N, width)
  std::vector<Vec3d> positions;  // (N), the first three again
};

void read_row(std::string_view line, const std::vector<int>& targets, const Lines& lines,
              Rows& rows) {
  const auto fail = [&](const std::string& what) {
    cannot_read(lines.path(), fmt::format("line {} {}; correct that line or export the table again",
                                          lines.number(), what));
  };
  const std::size_t row = rows.values.size();
  rows.values.resize(row + rows.width);
  Vec3d& position = rows.positions.emplace_back(0.0);
  Fields fields{line};
  for (std::size_t at = 0; at < targets.size(); ++at) {
    if (fields.done) fail(fmt::format("has {} values instead of {}", at, targets.size()));
    const std::string_view word = fields.next();
    const int target = targets[at];
    if (target < 0) continue;
    if (!parse_float(word, rows.values[row + target]))
      fail(fmt::format("has \"{}\", which is not a number", word.substr(0, 40)));
    if (target < 3 && !parse_number(word, position[target])) position[target] = INFINITY;
  }
  if (!fields.done) fail(fmt::format("has more than {} values", targets.size()));
}

/// The world offset of these positions, where floats would lose too much of them.
Vec3d offset_of(const std::vector<Vec3d>& positions) {
  std::vector<Vec3d> finite;
  for (const Vec3d& position : positions)
    if (is_finite(position)) finite.push_back(position);
  return world_offset_of(finite, kMostLost);
}

/// The shortest text that reads as the same number again.
template <class T>
void append_number(std::string& text, T number) {
  char digits[kLongestNumber];
  text.append(digits, std::to_chars(digits, digits + sizeof digits, number).ptr);
}

}  // namespace

GaussianModel read_csv(const std::filesystem::path& path) {
  Lines lines(path);
  std::string_view line;
  if (!lines.next(line)) cannot_read(path, "it is empty; export the table again");
  const PlyElement table = columns_of(line);
  GaussianModel model{Gaussians(), sh_degree_of(table, path), false, false};
  const std::size_t width = gaussian_columns(model.gaussians, model.sh_degree).size();
  const std::vector<int> targets =
      targets_of(table, gaussian_columns(model.gaussians, model.sh_degree), path);
  Rows rows{width, {}, {}};
  while (lines.next(line)) read_row(line, targets, lines, rows);
  const std::size_t count = rows.positions.size();
  model.gaussians.resize(count);
  model.gaussians.sh_rest.fill_zero();
  const std::vector<PlyColumn> columns = gaussian_columns(model.gaussians, model.sh_degree);
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t c = 0; c < width; ++c)
      columns[c].array[i * columns[c].stride + columns[c].offset] = rows.values[i * width + c];
  model.world_offset = offset_of(rows.positions);
  if (model.world_offset == Vec3d(0.0)) return model;
  for (std::size_t i = 0; i < count; ++i)
    model.gaussians.mean[i] = Vec3f(rows.positions[i] - model.world_offset);
  return model;
}

void write_csv(const std::filesystem::path& path, const GaussianModel& model) {
  const std::vector<PlyColumn> columns = gaussian_columns(model.gaussians, model.sh_degree);
  const bool is_far = model.world_offset != Vec3d(0.0);
  std::string text;
  for (const PlyColumn& column : columns) text += (text.empty() ? "" : ",") + column.property;
  AtomicFile file(path);
  for (std::size_t i = 0; i < model.gaussians.count(); ++i) {
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const float number = columns[c].array[i * columns[c].stride + columns[c].offset];
      text += c == 0 ? '\n' : ',';
      if (c < 3 && is_far)
        append_number(text, double(number) + model.world_offset[int(c)]);
      else
        append_number(text, number);
    }
    if (text.size() < kWriteBytes) continue;
    file.write(text);
    text.clear();
  }
  file.write(text + "\n");
  file.commit();
}

}  // namespace gs
