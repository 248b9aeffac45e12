// SPDX-License-Identifier: Apache-2.0
#include "gs_model/mesh/mesh_read.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>
#include <vector>

#include "gs_core/error.h"
#include "gs_core/geometry/world_offset.h"
#include "gs_core/system/text/parse_number.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/glb/glb_file.h"
#include "gs_model/formats/ply/ply_file.h"

namespace gs {
namespace {

using Path = std::filesystem::path;
constexpr std::array<const char*, 3> kColorNames = {"red", "green", "blue"};
constexpr Rgb8 kWhite = {255, 255, 255};

/// Adds the triangles of a polygon. A corner beyond the vertices is found by check_mesh().
void add_polygon(TriangleMesh& mesh, const std::vector<std::uint64_t>& corners) {
  const auto vertex = [&](std::size_t k) {
    return std::uint32_t(std::min<std::uint64_t>(corners[k], ~0u));
  };
  for (std::size_t k = 2; k < corners.size(); ++k)
    mesh.triangles.push_back({vertex(0), vertex(k - 1), vertex(k)});
}

Rgb8 rgb8_of(const Vec3f& color) {
  return {std::uint8_t(to_unorm(color.x, 8)), std::uint8_t(to_unorm(color.y, 8)),
          std::uint8_t(to_unorm(color.z, 8))};
}

MeshOfFile read_ply_mesh(const Path& path) {
  PlyFile file(path);
  const PlyElement* const vertex = file.header().find("vertex");
  if (!vertex || vertex->find("x") < 0 || vertex->find("y") < 0 || vertex->find("z") < 0)
    cannot_read(path, "it has no vertices with x, y and z; name a mesh or points");
  MeshOfFile result{{}, offset_of_comments(file.header().comments)};
  TriangleMesh& mesh = result.mesh;
  const auto table = [&](std::vector<Vec3f>& rows, std::array<const char*, 3> names) {
    std::vector<PlyColumn> columns;
    rows.resize(vertex->count);
    for (std::size_t k = 0; k < 3; ++k)
      columns.push_back({names[k], rows.empty() ? nullptr : &rows[0].x, k, 3});
    return columns;
  };
  std::vector<PlyTable> tables = {{vertex, table(mesh.vertices, {"x", "y", "z"})}};
  if (vertex->find("nx") >= 0 && vertex->find("ny") >= 0 && vertex->find("nz") >= 0)
    for (PlyColumn& column : table(mesh.normals, {"nx", "ny", "nz"}))
      tables[0].columns.push_back(std::move(column));
  std::vector<Vec3f> colors;
  const bool has_colors = std::ranges::all_of(kColorNames, [&](const char* name) {
    const int k = vertex->find(name);
    return k >= 0 && vertex->properties[std::size_t(k)].type == PlyType::uint8;
  });
  if (has_colors)
    for (PlyColumn& column : table(colors, kColorNames))
      tables[0].columns.push_back(std::move(column));
  if (const PlyElement* const face = file.header().find("face"))
    for (const PlyProperty& property : face->properties)
      if (property.count_type &&
          (property.name == "vertex_indices" || property.name == "vertex_index")) {
        PlyColumn column{property.name};
        column.take_list = [&](const auto& corners) { add_polygon(mesh, corners); };
        tables.push_back({face, {std::move(column)}});
        break;
      }
  file.read_tables(tables);
  for (const Vec3f& color : colors) mesh.colors.push_back(rgb8_of(kPerByte * color));
  return result;
}

std::string_view next_word(std::string_view& line) {
  const std::size_t begin = std::min(line.find_first_not_of(" \t\r"), line.size());
  const std::size_t end = std::min(line.find_first_of(" \t\r", begin), line.size());
  const std::string_view word = line.substr(begin, end - begin);
  line.remove_prefix(end);
  return word;
}

/// The lines "v x y z" and "f a b c ...", where a corner may go on as "a/b/c" and counts from 1, or
/// backwards from the last vertex so far.
MeshOfFile read_obj_mesh(const Path& path) {
  MeshOfFile result;
  TriangleMesh& mesh = result.mesh;
  ByteReader reader(path);
  std::vector<std::string> comments;
  for (std::size_t number = 1; reader.left() > 0; ++number) {
    std::optional<std::string_view> line = reader.take_line();
    if (!line) {  // the last one, without its end
      const std::size_t rest = reader.left();
      line = {reinterpret_cast<const char*>(reader.take(rest)), rest};
    }
    const auto fail = [&](std::string_view word) {
      cannot_read(path, fmt::format("line {} has \"{}\" for a number; export it again", number,
                                    word.substr(0, 40)));
    };
    const std::string_view kind = next_word(*line);
    if (kind == "#") comments.emplace_back(line->substr(std::min<std::size_t>(1, line->size())));
    if (kind == "v") {
      Vec3f& at = mesh.vertices.emplace_back();
      for (int axis = 0; axis < 3; ++axis)
        if (const std::string_view word = next_word(*line); !parse_float(word, at[axis]))
          fail(word);
      Vec3f color;  // behind the position, unless there is a weight or nothing
      int numbers = 0;
      while (numbers < 3 && parse_float(next_word(*line), color[numbers])) ++numbers;
      if (numbers == 3) mesh.colors.push_back(rgb8_of(color));
    }
    if (kind != "f") continue;
    std::vector<std::uint64_t> corners;
    for (std::string_view word; !(word = next_word(*line)).empty();) {
      std::int64_t corner = 0;
      if (!parse_number(word.substr(0, word.find('/')), corner)) fail(word);
      corners.push_back(
          std::uint64_t(corner < 0 ? std::int64_t(mesh.vertices.size()) + corner : corner - 1));
    }
    add_polygon(mesh, corners);
  }
  if (mesh.colors.size() != mesh.vertices.size()) mesh.colors.clear();
  result.world_offset = offset_of_comments(comments);
  return result;
}

MeshOfFile read_stl_mesh(const Path& path) {
  constexpr std::size_t kHeaderBytes = 80, kTriangleBytes = 50, kNormalBytes = 12;
  ByteReader reader(path);
  std::uint64_t count = 0;
  if (reader.size() >= kHeaderBytes + 4) {
    reader.skip(kHeaderBytes);
    count = load_little<std::uint32_t>(reader.take(4));
  }
  if (reader.size() != kHeaderBytes + 4 + count * kTriangleBytes)
    cannot_read(path, "as a .stl it is text or cut short; save it as a binary .stl or as .ply");
  MeshOfFile result;
  for (std::uint32_t t = 0; t < count; ++t) {
    const std::uint8_t* const corners = reader.take(kTriangleBytes) + kNormalBytes;
    for (std::size_t k = 0; k < 3; ++k)
      result.mesh.vertices.push_back(load_little<Vec3f>(corners + k * sizeof(Vec3f)));
    result.mesh.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
  }
  return result;
}

/// Adds the colors of the newest `count` vertices, which a .glb has as linear light; those before them that
/// have none are white, as glTF says.
void add_colors(const GlbFile& glb, std::uint64_t accessor, std::size_t count, TriangleMesh& mesh) {
  const SortedJson* const type = GlbFile::find(glb.item("accessors", accessor), "type");
  const GlbRows rows(glb, accessor, type && *type == "VEC3" ? 3 : 4);
  if (rows.count() != count) glb.fail("has not a color for each position");
  mesh.colors.resize(mesh.vertices.size() - rows.count(), kWhite);
  for (std::size_t v = 0; v < rows.count(); ++v) {
    const Vec3f linear = rows.vec3(v);
    mesh.colors.push_back(rgb8_of({srgb_of(linear.x), srgb_of(linear.y), srgb_of(linear.z)}));
  }
}

/// The PNG that a primitive's material has for its colors, or nothing.
std::string_view texture_of(const GlbFile& glb, const SortedJson& primitive) {
  if (!GlbFile::find(primitive, "material")) return {};
  const SortedJson& material = glb.item("materials", glb.number(primitive, "material"));
  const SortedJson* const looks = GlbFile::find(material, "pbrMetallicRoughness");
  const SortedJson* const use = looks ? GlbFile::find(*looks, "baseColorTexture") : nullptr;
  if (!use || glb.number(*use, "texCoord", 0) != 0) return {};
  const SortedJson& texture = glb.item("textures", glb.number(*use, "index"));
  const SortedJson& image = glb.item("images", glb.number(texture, "source"));
  const SortedJson* const kind = GlbFile::find(image, "mimeType");
  if (!kind || *kind != "image/png") return {};
  return glb.view(glb.number(image, "bufferView"));
}

/// The triangles of all primitives, as they are without their nodes.
MeshOfFile read_glb_mesh(const Path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  const GlbFile glb(path, {reinterpret_cast<const char*>(reader.take(size)), size});
  check_nodes(glb);
  MeshOfFile result{{}, world_offset_of(glb)};
  std::set<std::string_view> textures;
  for (const SortedJson& mesh : glb.list("meshes")) {
    const SortedJson* const primitives = GlbFile::find(mesh, "primitives");
    for (std::size_t p = 0; primitives && primitives->is_array() && p < primitives->size(); ++p) {
      const SortedJson& primitive = (*primitives)[p];
      constexpr std::uint64_t kTriangles = 4;
      const SortedJson* const attributes = GlbFile::find(primitive, "attributes");
      if (!attributes || glb.number(primitive, "mode", kTriangles) != kTriangles) continue;
      const GlbRows at(glb, glb.number(*attributes, "POSITION"), 3);
      const std::uint64_t first = result.mesh.vertices.size();
      for (std::size_t v = 0; v < at.count(); ++v)
        result.mesh.vertices.push_back(at.vec3(v) * kHalfTurnZ);
      if (GlbFile::find(*attributes, "COLOR_0"))
        add_colors(glb, glb.number(*attributes, "COLOR_0"), at.count(), result.mesh);
      if (const std::string_view png = texture_of(glb, primitive);
          !png.empty() && GlbFile::find(*attributes, "TEXCOORD_0")) {
        const GlbRows places(glb, glb.number(*attributes, "TEXCOORD_0"), 2);
        if (places.count() != at.count()) glb.fail("has not a texture place for each position");
        for (std::size_t v = 0; v < places.count(); ++v)
          result.mesh.texture_places.emplace_back(places(v, 0), places(v, 1));
        textures.insert(png);
      }
      std::optional<GlbRows> indices;
      if (GlbFile::find(primitive, "indices"))
        indices.emplace(glb, glb.number(primitive, "indices"), 1, true);
      const std::size_t corners = indices ? indices->count() : at.count();
      if (result.mesh.vertices.size() + 3 * result.mesh.triangles.size() + corners > size)
        glb.fail("has primitives that share arrays, which are not read");
      const auto corner = [&](std::size_t k) { return first + (indices ? indices->whole(k) : k); };
      for (std::size_t k = 0; k + 2 < corners; k += 3)
        add_polygon(result.mesh, {corner(k), corner(k + 1), corner(k + 2)});
    }
  }
  if (!result.mesh.colors.empty()) result.mesh.colors.resize(result.mesh.vertices.size(), kWhite);
  if (result.mesh.texture_places.size() == result.mesh.vertices.size() && textures.size() == 1)
    result.texture_png = *textures.begin();
  else
    result.mesh.texture_places.clear();
  return result;
}

void check_mesh(const Path& path, const TriangleMesh& mesh) {
  if (mesh.vertices.empty())
    cannot_read(path, "it is empty: it has no vertex; name a mesh or points");
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
    if (!is_finite(mesh.vertices[v]))
      cannot_read(path, fmt::format("vertex {} is not finite; export it again", v));
  for (std::size_t v = 0; v < mesh.texture_places.size(); ++v)
    if (!std::isfinite(mesh.texture_places[v].x) || !std::isfinite(mesh.texture_places[v].y))
      cannot_read(path, fmt::format("the texture place of vertex {} is not finite; export it "
                                    "again",
                                    v));
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const std::uint32_t v : mesh.triangles[t])
      if (v >= mesh.vertices.size())
        cannot_read(path, fmt::format("triangle {} has a vertex that is not there; it has {} "
                                      "vertices; export it again",
                                      t, mesh.vertices.size()));
}

}  // namespace

MeshOfFile read_mesh(const Path& path) {
  const std::string ending = path.extension().string();
  const auto read = ending == ".ply"   ? read_ply_mesh
                    : ending == ".obj" ? read_obj_mesh
                    : ending == ".glb" ? read_glb_mesh
                    : ending == ".stl" ? read_stl_mesh
                                       : nullptr;
  if (!read)
    throw UsageError(path.string() +
                     ": meshes are read as .glb, .obj, .ply or .stl; name such a file");
  MeshOfFile result = read(path);
  check_mesh(path, result.mesh);
  return result;
}

}  // namespace gs
