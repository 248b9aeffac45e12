// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/formats/lod/streamed_sog.h"
#include "gs_model/formats/sog/sog.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

constexpr const char* kRemedyOfStreamedSog = "export the folder again";
constexpr std::uint64_t kMostRows = std::uint32_t(-1);

/// Rows of a file that belong to one leaf.
struct Interval {
  std::uint64_t offset, count;
};

/// lod-meta.json: what is missing or of another kind is an Error.
class LodMeta {
 public:
  LodMeta(const Path& path, int level)
      : path_(path), meta_(read_json_as<SortedJson>(path, kRemedyOfStreamedSog)), level_(level) {
    if (!meta_.is_object()) fail("is no JSON object");
    if (number(meta_, "version", 1000) != 1)
      cannot_read(path, "it is a streamed SOG of a version other than 1; export it as version 1");
    check_level();
    if (!meta_.contains("filenames") || !meta_["filenames"].is_array()) fail("lacks filenames");
    if (!meta_.contains("tree")) fail("lacks a tree");
    collect(meta_["tree"]);
  }

  /// The rows to read of each file.
  const std::map<Path, std::vector<Interval>>& intervals() const { return intervals_; }
  /// The Gaussians around the scene; empty without them.
  Path environment() const {
    return meta_.contains("environment") ? beside(meta_["environment"]) : Path();
  }
  [[noreturn]] void fail(const std::string& what) const {
    cannot_read(path_, fmt::format("as a streamed SOG it {}; it is damaged, {}", what,
                                   kRemedyOfStreamedSog));
  }

 private:
  void check_level() const {
    if (level_ == 0 || !meta_.contains("lodLevels")) return;
    const std::uint64_t levels = number(meta_, "lodLevels", kMostLevels);
    if (std::uint64_t(level_) >= levels)
      cannot_read(path_, fmt::format("it has no level {}; its levels are 0, the finest, to {}",
                                     level_, levels - 1));
  }
  std::uint64_t number(const SortedJson& object, const char* key, std::uint64_t most) const {
    if (!object.contains(key) || !object[key].is_number_unsigned() ||
        object[key].get<std::uint64_t>() > most)
      fail(fmt::format("has no valid number \"{}\"", key));
    return object[key].get<std::uint64_t>();
  }
  // A file inside the folder.
  Path beside(const SortedJson& name) const {
    if (!name.is_string()) fail("names a file that is no text");
    const auto text = name.get<std::string>();
    const Path file = Path(text).lexically_normal();
    if (text.empty() || file.is_absolute() || *file.begin() == ".." || text.find('\0') != text.npos)
      cannot_read(path_, fmt::format("it names {}, which is not in its folder; put all its files "
                                     "into one folder and write their names relative to it",
                                     shown_word(text)));
    return path_.parent_path() / file;
  }
  // read_json_as() has checked that nothing nests deep.
  void collect(const SortedJson& node) {
    if (!node.is_object()) fail("has a node that is no JSON object");
    if (node.contains("lods")) return collect_leaf(node["lods"]);
    if (!node.contains("children") || !node["children"].is_array())
      fail("has a node with neither children nor levels");
    for (const SortedJson& child : node["children"]) collect(child);
  }
  void collect_leaf(const SortedJson& lods) {
    if (!lods.is_object()) fail("has a leaf without levels");
    const SortedJson* chosen = nullptr;
    for (int k = level_; !chosen && k >= 0; --k)
      if (const auto lod = lods.find(std::to_string(k)); lod != lods.end()) chosen = &*lod;
    for (int k = level_ + 1; !chosen && k < kMostLevels; ++k)
      if (const auto lod = lods.find(std::to_string(k)); lod != lods.end()) chosen = &*lod;
    if (!chosen) return;
    if (!chosen->is_object()) fail("has a level that is no JSON object");
    const std::uint64_t count = number(*chosen, "count", kMostRows);
    if (count == 0) return;
    const std::uint64_t file = number(*chosen, "file", kMostRows);
    if (file >= meta_["filenames"].size()) fail("has a level in a file that it does not name");
    const std::uint64_t offset =
        chosen->contains("offset") ? number(*chosen, "offset", kMostRows) : 0;
    intervals_[beside(meta_["filenames"][file])].push_back({offset, count});
  }

  static constexpr int kMostLevels = 64;  // each has fewer Gaussians than the one before it

  const Path& path_;
  SortedJson meta_;
  int level_;
  std::map<Path, std::vector<Interval>> intervals_;
};

/// The model in the making.
class Parts {
 public:
  explicit Parts(const LodMeta& meta) : meta_(meta) {}

  void add(const GaussianModel& file, const std::vector<Interval>& intervals) {
    const std::uint64_t rows = file.gaussians.count();
    std::uint64_t left = rows;  // intervals that overlap would multiply the Gaussians
    for (const Interval& interval : intervals) {
      if (interval.offset > rows || interval.count > rows - interval.offset ||
          interval.count > left)
        meta_.fail("names rows that its files do not have");
      left -= interval.count;
      append(file.gaussians, interval);
    }
    model_.sh_degree = std::max(model_.sh_degree, file.sh_degree);
    model_.antialiased = model_.antialiased || file.antialiased;
    model_.is_ours = model_.is_ours && file.is_ours;
  }
  GaussianModel take() { return std::move(model_); }

 private:
  void append(const Gaussians& from, const Interval& interval) {
    const std::size_t before = model_.gaussians.count();
    model_.gaussians.resize(before + interval.count);
    copy_rows(from, interval.offset, interval.count, model_.gaussians, before);
  }

  const LodMeta& meta_;
  GaussianModel model_{Gaussians(), 0};
};

}  // namespace

GaussianModel read_streamed_sog(const Path& lod_meta, int level) {
  const LodMeta meta(lod_meta, level);
  Parts parts(meta);
  for (const auto& [file, intervals] : meta.intervals())
    parts.add(read_sog_folder(file), intervals);
  if (const Path environment = meta.environment(); !environment.empty()) {
    const GaussianModel around = read_sog_folder(environment);
    parts.add(around, {{0, around.gaussians.count()}});
  }
  return parts.take();
}

}  // namespace gs
