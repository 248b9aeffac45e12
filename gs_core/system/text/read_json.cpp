// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/text/read_json.h"

#include <spdlog/fmt/fmt.h>

#include <vector>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

constexpr std::string_view kRemedyOfRuns = "move it away to do without it, or train again";

// Bytes of memory that parsed values take at most, about: 100,000 frames of transforms.json.
constexpr std::uint64_t kMostTreeBytes = std::uint64_t(192) << 20;
constexpr std::uint64_t kObjectBytes = 80, kListBytes = 64, kValueBytes = 32, kKeyBytes = 80;
// Comparisons of keys, about a second: 20,000 keys in one object.
constexpr std::uint64_t kMostComparisons = 200'000'000;

/// What a text will cost. It need not be valid JSON; the parser finds that out.
class JsonMeasure {
 public:
  JsonMeasure(std::string_view text, bool searches_keys) {
    for (std::size_t at = 0; at < text.size() && is_fine(); ++at) {
      switch (text[at]) {
        case '"': at = end_of_string(text, at); break;
        case '{': open(kObjectBytes); break;
        case '[': open(kListBytes); break;
        case '}':
        case ']':
          if (!keys_.empty()) keys_.pop_back();
          break;
        case ',': tree_bytes_ += kValueBytes; break;
        case ':':
          tree_bytes_ += kKeyBytes;
          if (searches_keys && !keys_.empty()) comparisons_ += keys_.back()++;
          break;
        default: break;
      }
    }
  }

  bool is_too_deep() const { return keys_.size() > std::size_t(kDeepestJson); }
  bool is_too_large() const {
    return tree_bytes_ > kMostTreeBytes || comparisons_ > kMostComparisons;
  }

 private:
  bool is_fine() const { return !is_too_deep() && !is_too_large(); }
  void open(std::uint64_t bytes) {
    tree_bytes_ += bytes;
    keys_.push_back(0);
  }
  /// The place of the quote that ends the string, or the end of the text.
  static std::size_t end_of_string(std::string_view text, std::size_t at) {
    for (++at; at < text.size() && text[at] != '"'; ++at)
      if (text[at] == '\\') ++at;
    return at;
  }

  std::vector<std::uint64_t> keys_;  // of each object or list that is open
  std::uint64_t tree_bytes_ = 0, comparisons_ = 0;
};

}  // namespace

void measure_json(const std::filesystem::path& path, std::string_view text, std::string_view remedy,
                  bool searches_keys) {
  const JsonMeasure measure(text, searches_keys);
  if (measure.is_too_deep())
    cannot_read(path, fmt::format("it nests deeper than {} levels; {}", kDeepestJson, remedy));
  if (measure.is_too_large())
    cannot_read(path, fmt::format("it holds too many values to fit into memory; {}", remedy));
}

std::string read_json_text(const std::filesystem::path& path) {
  return read_text_file(path, kLargestJson);
}

Json read_json(const std::filesystem::path& path) {
  Json json = read_json_as(path, kRemedyOfRuns);
  if (!json.is_object()) cannot_read(path, fmt::format("it is damaged; {}", kRemedyOfRuns));
  return json;
}

void detail::no_json(const std::filesystem::path& path, std::size_t byte, std::string_view remedy) {
  cannot_read(path, fmt::format("it is not JSON from byte {} on (JSON has no NaN or Infinity); the "
                                "file is cut short or damaged, {}",
                                byte, remedy));
}

void detail::no_number(const std::filesystem::path& path, std::string_view remedy) {
  cannot_read(path,
              fmt::format("its JSON holds a number that is not finite; correct it or {}", remedy));
}

void detail::other_form(const std::filesystem::path& path, const char* what,
                        std::string_view remedy) {
  // "[json.exception.type_error.302] type must be number, but is string": the part behind the mark
  const std::string_view text(what);
  const std::size_t mark = text.starts_with('[') ? text.find("] ") : text.npos;
  cannot_read(path, fmt::format("it has another form than expected ({}); {}",
                                mark == text.npos ? text : text.substr(mark + 2), remedy));
}

}  // namespace gs
