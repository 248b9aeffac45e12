// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_model/edit/merge_gaussians.h"
#include "gs_model/formats/lod/streamed_sog.h"
#include "gs_model/formats/sog/sog.h"

namespace gs {
namespace {

/// A box that holds ellipsoids of one standard deviation.
struct Bound {
  Vec3f low{INFINITY}, high{-INFINITY};

  void add(const Vec3f& a, const Vec3f& b) {
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], a[axis]);
      high[axis] = std::max(high[axis], b[axis]);
    }
  }
  void add(const Gaussians& g, std::size_t i) {
    const Sym3<float> sigma = merge_shape_of(g, i).sigma;
    const Vec3f half{std::sqrt(sigma.xx), std::sqrt(sigma.yy), std::sqrt(sigma.zz)};
    add(g.mean[i] - half, g.mean[i] + half);
  }
  Json json() const { return {{"min", {low.x, low.y, low.z}}, {"max", {high.x, high.y, high.z}}}; }
};

/// Where the rows of a leaf at a level lie.
struct Place {
  std::size_t file = 0, offset = 0, count = 0;
};

class Writer {
 public:
  Writer(const std::filesystem::path& folder, const LodTree& tree,
         const StreamedSogOptions& options)
      : folder_(folder), tree_(tree), options_(options),
        places_(tree.levels.size(), std::vector<Place>(tree.num_leaves())) {}

  std::vector<StreamedLevel> write() {
    std::vector<StreamedLevel> written;
    for (std::size_t k = 0; k < tree_.levels.size(); ++k) written.push_back(write_level(k));
    Json meta = {{"version", 1},
                 {"asset", {{"generator", fmt::format("gemsplat {}", kVersion)}}},
                 {"count", 0},
                 {"counts", Json::array()},
                 {"lodLevels", written.size()},
                 {"lodErrors", false},
                 {"filenames", filenames_}};
    std::size_t count = 0;
    for (const StreamedLevel& level : written) {
      meta["counts"].push_back(level.gaussians);
      count += level.gaussians;
    }
    meta["count"] = count;
    Bound whole;
    meta["tree"] = node_json(0, whole);
    AtomicFile file(folder_ / kLodMeta);
    file.write(meta.dump());
    file.commit();
    return written;
  }

 private:
  // Leaves share files as long as these do not get too large.
  StreamedLevel write_level(std::size_t k) {
    const std::vector<std::size_t>& begin = tree_.levels[k].leaf_begin;
    StreamedLevel written{tree_.levels[k].gaussians.count(), 0};
    std::size_t first = 0;
    for (std::size_t chunk = 0; first < tree_.num_leaves(); ++chunk) {
      std::size_t last = first + 1;
      while (last < tree_.num_leaves() && begin[last + 1] - begin[first] <= options_.file_rows)
        ++last;
      for (std::size_t leaf = first; leaf < last; ++leaf)
        places_[k][leaf] = {filenames_.size(), begin[leaf] - begin[first],
                            begin[leaf + 1] - begin[leaf]};
      written.bytes += write_file(k, chunk, begin[first], begin[last]);
      first = last;
    }
    return written;
  }

  std::uint64_t write_file(std::size_t level, std::size_t chunk, std::size_t from, std::size_t to) {
    std::vector<std::uint32_t> rows(to - from);
    std::iota(rows.begin(), rows.end(), std::uint32_t(from));
    const GaussianModel model{rows_of(tree_.levels[level].gaussians, rows), options_.sh_degree,
                              true, options_.antialiased};
    const std::string name = fmt::format("{}_{}", level, chunk);
    filenames_.push_back(name + "/meta.json");
    return write_sog_folder(folder_ / name, model);
  }

  // Adds what the node holds to `around`.
  Json node_json(std::size_t index, Bound& around) const {
    const LodNode& node = tree_.nodes[index];
    Bound bound;
    Json children = Json::array(), lods;
    if (node.is_leaf()) {
      for (std::size_t k = 0; k < tree_.levels.size(); ++k) {
        const LodLevel& level = tree_.levels[k];
        const Place& place = places_[k][node.first_leaf];
        const std::size_t begin = level.leaf_begin[node.first_leaf];
        for (std::size_t i = begin; i < begin + place.count; ++i) bound.add(level.gaussians, i);
        lods[std::to_string(k)] = {
            {"file", place.file}, {"offset", place.offset}, {"count", place.count}};
      }
    } else {
      for (const std::uint32_t child : node.children) children.push_back(node_json(child, bound));
    }
    around.add(bound.low, bound.high);
    Json json = {{"bound", bound.json()}};
    if (node.is_leaf())
      json["lods"] = std::move(lods);
    else
      json["children"] = std::move(children);
    return json;
  }

  const std::filesystem::path& folder_;
  const LodTree& tree_;
  const StreamedSogOptions& options_;
  std::vector<std::vector<Place>> places_;  // by level and leaf
  std::vector<std::string> filenames_;
};

}  // namespace

std::vector<StreamedLevel> write_streamed_sog(const std::filesystem::path& folder,
                                              const LodTree& tree,
                                              const StreamedSogOptions& options) {
  return Writer(folder, tree, options).write();
}

}  // namespace gs
