// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/glb/glb_scene.h"

#include <spdlog/fmt/fmt.h>

#include <array>
#include <cmath>
#include <optional>

#include "gs_core/system/byte_reader.h"
#include "gs_model/formats/glb/glb.h"

namespace gs {
namespace {

// Names under which an .spz stands in glTF: that of the draft, and two older ones.
constexpr const char* kSpzExtensions[] = {"KHR_gaussian_splatting_compression_spz_2",
                                          "KHR_gaussian_splatting_compression_spz",
                                          "KHR_spz_gaussian_splats_compression"};
constexpr int kDeepestNode = 64;              // real scenes nest below 20
constexpr std::size_t kMostInstances = 4096;  // each is decoded; real scenes have below 100
constexpr double kRounding = 1e-4;            // of matrices that were written as floats
constexpr double kMostScale = 1e6;            // of a node, and its inverse the least

/// `count` finite numbers of a node, or nothing where it has no such member.
template <std::size_t count>
std::optional<std::array<double, count>> numbers(const GlbFile& glb, const SortedJson& node,
                                                 const char* key) {
  const SortedJson* list = GlbFile::find(node, key);
  if (!list) return {};
  std::array<double, count> result;
  bool is_valid = list->is_array() && list->size() == count;
  for (std::size_t i = 0; is_valid && i < count; ++i) {
    is_valid = (*list)[i].is_number() && std::isfinite((*list)[i].template get<double>());
    if (is_valid) result[i] = (*list)[i].template get<double>();
  }
  if (!is_valid) glb.fail(fmt::format("has a node whose \"{}\" is not {} numbers", key, count));
  return result;
}

[[noreturn]] void fail_as_distorted(const GlbFile& glb) {
  cannot_read(glb.path(),
              "a node mirrors, stretches or shears its Gaussians, and gemsplat turns, moves and "
              "scales them evenly; apply the node in the program that wrote the file, and export "
              "it again");
}

[[noreturn]] void fail_as_crowded(const GlbFile& glb) {
  cannot_read(
      glb.path(),
      fmt::format("its nodes show Gaussians in more than {} places; join them in the program "
                  "that wrote the file, and export it again",
                  kMostInstances));
}

void check_similarity(const GlbFile& glb, const Mat4d& a) {
  Vec3d column[3];
  for (int j = 0; j < 3; ++j) column[j] = {a.m[0][j], a.m[1][j], a.m[2][j]};
  const double square = inner(column[0], column[0]);
  bool is_similar = square > 1 / (kMostScale * kMostScale) && square < kMostScale * kMostScale;
  for (int j = 0; j < 3; ++j)
    for (int k = 0; k < 3; ++k)
      is_similar = is_similar && std::abs(inner(column[j], column[k]) - (j == k ? square : 0)) <=
                                     kRounding * square;
  const bool is_mirror = inner(cross(column[0], column[1]), column[2]) < 0;
  if (!is_similar || is_mirror ||
      std::abs(a.m[3][0]) + std::abs(a.m[3][1]) + std::abs(a.m[3][2]) + std::abs(a.m[3][3] - 1) >
          kRounding)
    fail_as_distorted(glb);
}

/// What a node does, from its matrix (column by column) or its translation, rotation and scale.
Mat4d matrix_of(const GlbFile& glb, const SortedJson& node) {
  Mat4d result = diagonal(Vec3f(1));
  if (const auto matrix = numbers<16>(glb, node, "matrix")) {
    for (int i = 0; i < 16; ++i) result.m[i % 4][i / 4] = (*matrix)[std::size_t(i)];
    check_similarity(glb, result);
    return result;
  }
  const auto rotation = numbers<4>(glb, node, "rotation");
  const auto scale = numbers<3>(glb, node, "scale"), move = numbers<3>(glb, node, "translation");
  if (rotation) {
    const auto [x, y, z, w] = *rotation;
    const double length = std::sqrt(w * w + x * x + y * y + z * z);
    if (std::abs(length - 1) > 0.01) glb.fail("has a node whose rotation is not of length 1");
    const Quat<double> turn{w / length, x / length, y / length, z / length};
    result = matrix_of(ModelTransform{Vec3d(0.0), turn, 1});
  }
  for (int i = 0; i < 3; ++i)
    for (int j = 0; scale && j < 3; ++j) result.m[i][j] *= (*scale)[std::size_t(j)];
  for (int i = 0; move && i < 3; ++i) result.m[i][3] = (*move)[std::size_t(i)];
  check_similarity(glb, result);
  return result;
}

/// Walks the nodes of a scene and collects what they show.
class NodeWalk {
 public:
  explicit NodeWalk(const GlbFile& glb) : glb_(glb), is_visited_(glb.count("nodes")) {}

  void visit(std::uint64_t index, const Mat4d& scene_from_parent, int depth) {
    const SortedJson& node = glb_.item("nodes", index);
    if (is_visited_[index]) glb_.fail("has nodes that are no tree");
    is_visited_[index] = true;
    if (depth > kDeepestNode) glb_.fail(fmt::format("nests more than {} nodes", kDeepestNode));
    const Mat4d scene_from_node = multiply(scene_from_parent, matrix_of(glb_, node));
    if (GlbFile::find(node, "mesh"))
      add_mesh(glb_.number(node, "mesh"), scene_from_node, offset_of(node, scene_from_node));
    visit_all(GlbFile::find(node, "children"), scene_from_node, depth + 1);
  }
  void visit_all(const SortedJson* list, const Mat4d& scene_from_parent, int depth) {
    if (!list) return;
    if (!list->is_array()) glb_.fail("has a list of nodes that is no list");
    for (const SortedJson& index : *list) {
      if (!index.is_number_unsigned()) glb_.fail("names a node by something else than a number");
      visit(index.get<std::uint64_t>(), scene_from_parent, depth);
    }
  }
  void add_mesh(std::uint64_t index, const Mat4d& scene_from_mesh, const Vec3d& world_offset) {
    const SortedJson* primitives = GlbFile::find(glb_.item("meshes", index), "primitives");
    for (std::size_t p = 0; primitives && primitives->is_array() && p < primitives->size(); ++p)
      if (gaussians_in((*primitives)[p])) {
        if (instances.size() == kMostInstances) fail_as_crowded(glb_);
        instances.push_back({&(*primitives)[p], scene_from_mesh, world_offset});
      }
  }

  std::vector<GlbInstance> instances;

 private:
  /// As our writer puts it: only beside numbers that no node moves.
  Vec3d offset_of(const SortedJson& node, const Mat4d& scene_from_node) const {
    const SortedJson* extras = GlbFile::find(node, "extras");
    if (!extras || !GlbFile::find(*extras, "world_offset") || scene_from_node != diagonal(Vec3f(1)))
      return Vec3d(0.0);
    const auto offset = *numbers<3>(glb_, *extras, "world_offset");
    return {offset[0], offset[1], offset[2]};
  }

  const GlbFile& glb_;
  std::vector<bool> is_visited_;
};

}  // namespace

const SortedJson* spz_in(const SortedJson& extensions) {
  for (const char* name : kSpzExtensions)
    if (const SortedJson* spz = GlbFile::find(extensions, name)) return spz;
  return nullptr;
}

const SortedJson* gaussians_in(const SortedJson& primitive) {
  const SortedJson* extensions = GlbFile::find(primitive, "extensions");
  if (!extensions) return nullptr;
  return GlbFile::find(*extensions, kGlbGaussians) || spz_in(*extensions) ? extensions : nullptr;
}

std::vector<GlbInstance> glb_instances(const GlbFile& glb) {
  NodeWalk walk(glb);
  const Mat4d as_it_is = diagonal(Vec3f(1));
  if (glb.count("scenes") > 0) {
    const SortedJson& scene = glb.item("scenes", glb.number(glb.document(), "scene", 0));
    walk.visit_all(GlbFile::find(scene, "nodes"), as_it_is, 0);
  } else {
    for (std::uint64_t mesh = 0; mesh < glb.count("meshes"); ++mesh)
      walk.add_mesh(mesh, as_it_is, Vec3d(0.0));
  }
  if (walk.instances.empty())
    cannot_read(glb.path(),
                "its scene holds no Gaussians (KHR_gaussian_splatting); name a model of Gaussians, "
                "not of triangles");
  return std::move(walk.instances);
}

}  // namespace gs
