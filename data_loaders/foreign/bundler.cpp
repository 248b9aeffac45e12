// SPDX-License-Identifier: Apache-2.0
// bundle.out of Bundler, which many programs export, and the list of its photos. A camera looks along
// -z with y up; its polynomial 1 + k1 r^2 + k2 r^4 is that of Brown.
#include <spdlog/fmt/fmt.h>

#include <sstream>

#include "data_loaders/foreign/foreign_model.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMostText = std::uint64_t(1) << 30;  // bytes

class Words {
 public:
  Words(const ForeignModel& model, std::string text) : model_(model), text_(std::move(text)) {}
  double number() {
    const std::size_t begin = text_.find_first_not_of(" \t\r\n", next_);
    const std::size_t end = std::min(text_.find_first_of(" \t\r\n", begin), text_.size());
    double value = 0;
    if (begin == text_.npos ||
        !parse_number(std::string_view(text_).substr(begin, end - begin), value))
      model_.fail(fmt::format("a number is missing at byte {}; export it again", next_));
    next_ = end;
    return value;
  }
  Vec3d vector() {
    const double x = number(), y = number(), z = number();
    return {x, y, z};
  }
  std::size_t count() {
    const double value = number();
    if (!(value >= 0 && value <= double(text_.size())))
      model_.fail(
          fmt::format("it counts {} at byte {}, more than it has; export it again", value, next_));
    return std::size_t(value);
  }
  void skip_line() { next_ = std::min(text_.find('\n', next_), text_.size()); }

 private:
  const ForeignModel& model_;
  std::string text_;
  std::size_t next_ = 0;
};

std::vector<std::string> labels_of_bundler(const fs::path& list) {
  std::istringstream lines(read_text_file(list, kMostText));
  std::vector<std::string> labels;
  for (std::string line; std::getline(lines, line);) {
    if (line.ends_with('\r')) line.pop_back();
    // Bundler adds "0 FOCAL" behind a name.
    if (const std::size_t focal = line.find(" 0 "); focal != line.npos) line.resize(focal);
    if (!line.empty()) labels.push_back(line);
  }
  return labels;
}

}  // namespace

std::optional<fs::path> bundler_list(const fs::path& file) {
  const fs::path folder = file.parent_path();
  for (const fs::path& list :
       {fs::path(file).replace_extension(".txt"), fs::path(file.string() + "-list.txt"),
        folder / "list.txt", folder.parent_path() / "list.txt",
        folder.parent_path() / "prepare" / "list.txt"})
    if (is_file(list)) return list;
  return std::nullopt;
}

void read_bundler(ForeignModel& model) {
  const auto list = bundler_list(model.file());
  if (!list) model.fail("the list of its photos is not there; export it with list.txt beside it");
  const std::vector<std::string> labels = labels_of_bundler(*list);
  Words words(model, read_text_file(model.file(), kMostText));
  words.skip_line();  // # Bundle file v0.3
  const std::size_t cameras = words.count(), points = words.count();
  if (cameras > labels.size())
    model.fail(fmt::format("it has {} cameras, and {} names {} photos; export both again", cameras,
                           list->string(), labels.size()));
  for (std::size_t i = 0; i < cameras; ++i) {
    const double f = words.number(), k1 = words.number(), k2 = words.number();
    const Vec3d row0 = words.vector(), row1 = words.vector(), row2 = words.vector();
    const Vec3d t = words.vector();
    if (f == 0) continue;  // not placed
    const auto photo = model.photo(labels[i]);
    if (!photo) continue;
    const PhotoSize size = model.size_of(*photo);
    model.add(*photo, model.camera(size, {f, f, 0.5 * size.width, 0.5 * size.height, k1, k2}),
              {row0, row1, row2}, t, true);
  }
  for (std::size_t i = 0; i < points; ++i) {
    const Vec3d position = words.vector(), color = words.vector();
    model.add_point(position, color);
    for (std::size_t k = 4 * words.count(); k > 0; --k) words.number();  // where it was seen
  }
}

}  // namespace gs
