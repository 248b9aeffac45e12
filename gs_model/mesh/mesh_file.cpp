// SPDX-License-Identifier: Apache-2.0
#include "gs_model/mesh/mesh_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <limits>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/geometry/world_offset.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/glb/glb.h"
#include "gs_model/mesh/mesh_usd.h"

namespace gs {
namespace {

constexpr std::size_t kRowsPerWrite = 65536;
constexpr const char* kMaterial = "surface";

/// Writes rows in pieces, so that a large mesh is not in memory twice. append(text, i) adds row i.
template <class Append>
void write_rows(ByteSink& sink, std::size_t count, Append&& append) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) {
    append(text, i);
    if ((i + 1) % kRowsPerWrite != 0 && i + 1 != count) continue;
    sink.write(text);
    text.clear();
  }
}

std::string offset_line(const char* comment, const Vec3d& offset) {
  return offset == Vec3d(0.0)
             ? ""
             : fmt::format("{} world_offset {}\n", comment, text_of_offset(offset));
}

void write_mesh_ply(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                    const MeshTextureFile&, const std::vector<NamedView>&) {
  std::string header = "ply\nformat binary_little_endian 1.0\n" +
                       offset_line("comment", world_offset) +
                       fmt::format("element vertex {}\n", mesh.vertices.size());
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz"})
    header += fmt::format("property float {}\n", name);
  for (const char* name : {"red", "green", "blue"})
    header += fmt::format("property uchar {}\n", name);
  header += fmt::format("element face {}\nproperty list uchar int vertex_indices\nend_header\n",
                        mesh.triangles.size());
  sink.write(header);
  write_rows(sink, mesh.vertices.size(), [&](std::string& text, std::size_t v) {
    append_little(text, mesh.vertices[v]);
    append_little(text, mesh.normals[v]);
    append_little(text, mesh.colors[v]);
  });
  write_rows(sink, mesh.triangles.size(), [&](std::string& text, std::size_t t) {
    text += '\3';
    append_little(text, mesh.triangles[t]);
  });
}

void write_mesh_obj(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                    const MeshTextureFile& texture, const std::vector<NamedView>&) {
  const bool has_texture = !texture.png.empty();
  sink.write(offset_line("#", world_offset));
  if (has_texture) sink.write(fmt::format("mtllib {}.mtl\nusemtl {}\n", texture.name, kMaterial));
  // Colors behind the position, as MeshLab and Blender read them.
  write_rows(sink, mesh.vertices.size(), [&](std::string& text, std::size_t v) {
    const Vec3f& p = mesh.vertices[v];
    if (has_texture) {
      fmt::format_to(std::back_inserter(text), "v {} {} {}\n", p.x, p.y, p.z);
      return;
    }
    const Rgb8& c = mesh.colors[v];
    fmt::format_to(std::back_inserter(text), "v {} {} {} {:.4f} {:.4f} {:.4f}\n", p.x, p.y, p.z,
                   float(c[0]) / 255, float(c[1]) / 255, float(c[2]) / 255);
  });
  write_rows(sink, mesh.vertices.size(), [&](std::string& text, std::size_t v) {
    const Vec3f& n = mesh.normals[v];
    fmt::format_to(std::back_inserter(text), "vn {:.4f} {:.4f} {:.4f}\n", n.x, n.y, n.z);
  });
  if (has_texture)
    write_rows(sink, mesh.vertices.size(), [&](std::string& text, std::size_t v) {
      const Vec2f& at = mesh.texture_places[v];  // an .obj counts from the lower left corner
      fmt::format_to(std::back_inserter(text), "vt {:.6f} {:.6f}\n", at.x, 1 - at.y);
    });
  const char* const corner_line =
      has_texture ? "f {0}/{0}/{0} {1}/{1}/{1} {2}/{2}/{2}\n" : "f {0}//{0} {1}//{1} {2}//{2}\n";
  write_rows(sink, mesh.triangles.size(), [&](std::string& text, std::size_t i) {
    const Triangle& t = mesh.triangles[i];
    fmt::format_to(std::back_inserter(text), fmt::runtime(corner_line), t[0] + 1, t[1] + 1,
                   t[2] + 1);
  });
}

void write_mesh_stl(ByteSink& sink, const TriangleMesh& mesh, const Vec3d&, const MeshTextureFile&,
                    const std::vector<NamedView>&) {
  if (mesh.triangles.size() > std::numeric_limits<std::uint32_t>::max())
    throw Error(
        fmt::format("cannot write {}: a .stl has at most 2^32 triangles; choose .ply, or "
                    "give --decimate",
                    sink.name()));
  std::string header(80, ' ');
  append_little(header, std::uint32_t(mesh.triangles.size()));
  sink.write(header);
  write_rows(sink, mesh.triangles.size(), [&](std::string& text, std::size_t i) {
    const Triangle& t = mesh.triangles[i];
    const Vec3f &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const Vec3f n = cross(b - a, c - a);
    const float l = length(n);
    append_little(text, l > 0 ? n / l : Vec3f(0));
    for (const Vec3f& corner : {a, b, c}) append_little(text, corner);
    append_little(text, std::uint16_t(0));
  });
}

/// One array of a .glb. Numbers of glTF are those of OpenGL.
struct GlbArray {
  const char* type;  // VEC3, ...
  int component_type;
  std::size_t count, row_bytes;
  int target;
};

void write_mesh_glb(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                    const MeshTextureFile& texture, const std::vector<NamedView>&) {
  const bool has_texture = !texture.png.empty();
  constexpr int kFloat32 = 5126, kUint32 = 5125, kUint8 = 5121, kVertices = 34962, kIndices = 34963;
  const std::size_t vertices = mesh.vertices.size();
  const GlbArray arrays[] = {{"VEC3", kFloat32, vertices, 12, kVertices},
                             {"VEC3", kFloat32, vertices, 12, kVertices},
                             has_texture ? GlbArray{"VEC2", kFloat32, vertices, 8, kVertices}
                                         : GlbArray{"VEC4", kUint8, vertices, 4, kVertices},
                             {"SCALAR", kUint32, 3 * mesh.triangles.size(), 4, kIndices}};
  Json views, accessors;
  std::uint64_t bytes = 0;  // a multiple of 4, as every row is
  for (const GlbArray& array : arrays) {
    accessors.push_back({{"bufferView", views.size()},
                         {"componentType", array.component_type},
                         {"count", array.count},
                         {"type", array.type}});
    if (array.component_type == kUint8) accessors.back()["normalized"] = true;
    views.push_back({{"buffer", 0},
                     {"byteOffset", bytes},
                     {"byteLength", array.count * array.row_bytes},
                     {"target", array.target}});
    bytes += array.count * array.row_bytes;
  }
  const std::size_t padding = (4 - texture.png.size() % 4) % 4;
  if (has_texture) {
    views.push_back({{"buffer", 0}, {"byteOffset", bytes}, {"byteLength", texture.png.size()}});
    bytes += texture.png.size() + padding;
  }
  Vec3f low(std::numeric_limits<float>::max()), high = -low;
  for (const Vec3f& vertex : mesh.vertices)
    for (int axis = 0; axis < 3; ++axis) {
      const float value = vertex[axis] * kHalfTurnZ[axis];
      low[axis] = std::min(low[axis], value);
      high[axis] = std::max(high[axis], value);
    }
  accessors[0]["min"] = {low.x, low.y, low.z};
  accessors[0]["max"] = {high.x, high.y, high.z};
  Json node = {{"mesh", 0}};
  const Vec3d& offset = world_offset;
  if (offset != Vec3d(0.0)) node["extras"] = {{"world_offset", {offset.x, offset.y, offset.z}}};
  const char* const looks = has_texture ? "TEXCOORD_0" : "COLOR_0";
  const Json primitive = {{"attributes", {{"POSITION", 0}, {"NORMAL", 1}, {looks, 2}}},
                          {"indices", 3},
                          {"material", 0}};
  // The light is in the colors already, which viewers without the extension light again.
  const Json material = {{"doubleSided", true},
                         {"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}},
                         {"extensions", {{"KHR_materials_unlit", Json::object()}}}};
  Json document = {
      {"asset", {{"version", "2.0"}, {"generator", fmt::format("gemsplat {}", kVersion)}}},
      {"extensionsUsed", Json::array({"KHR_materials_unlit"})},
      {"scene", 0},
      {"scenes", Json::array({{{"nodes", Json::array({0})}}})},
      {"nodes", Json::array({node})},
      {"meshes", Json::array({{{"primitives", Json::array({primitive})}}})},
      {"materials", Json::array({material})},
      {"accessors", accessors},
      {"bufferViews", views},
      {"buffers", Json::array({{{"byteLength", bytes}}})}};
  if (has_texture) {
    constexpr int kLinear = 9729, kLinearMipmaps = 9987, kClamped = 33071;
    document["images"] = Json::array({{{"bufferView", 4}, {"mimeType", "image/png"}}});
    document["samplers"] = Json::array({{{"magFilter", kLinear},
                                         {"minFilter", kLinearMipmaps},
                                         {"wrapS", kClamped},
                                         {"wrapT", kClamped}}});
    document["textures"] = Json::array({{{"sampler", 0}, {"source", 0}}});
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", 0}};
  }
  const std::string head = glb_head(document.dump(), bytes);
  if (head.size() + bytes > std::numeric_limits<std::uint32_t>::max())
    throw Error(
        fmt::format("cannot write {}: the mesh takes more than the 4 GiB that a .glb can "
                    "have; choose .ply, or give --decimate",
                    sink.name()));
  sink.write(head);
  write_rows(sink, vertices, [&](std::string& text, std::size_t v) {
    append_little(text, mesh.vertices[v] * kHalfTurnZ);
  });
  write_rows(sink, vertices, [&](std::string& text, std::size_t v) {
    append_little(text, mesh.normals[v] * kHalfTurnZ);
  });
  write_rows(sink, vertices, [&](std::string& text, std::size_t v) {
    if (has_texture) return append_little(text, mesh.texture_places[v]);
    for (const std::uint8_t channel : mesh.colors[v])
      text += char(to_unorm(linear_of(float(channel) / 255), 8));
    text += char(255);
  });
  write_rows(sink, mesh.triangles.size(),
             [&](std::string& text, std::size_t t) { append_little(text, mesh.triangles[t]); });
  if (has_texture) sink.write(texture.png + std::string(padding, '\0'));
}

}  // namespace

std::string MeshTextureFile::material() const {
  return fmt::format("newmtl {}\nKa 0 0 0\nKd 1 1 1\nillum 0\nmap_Kd {}.png\n", kMaterial, name);
}

const MeshFormat& mesh_format_of(const std::filesystem::path& file) {
  static const MeshFormat kFormats[] = {
      {".glb", write_mesh_glb, true},  {".obj", write_mesh_obj, true}, {".ply", write_mesh_ply},
      {".stl", write_mesh_stl},        {".usda", write_mesh_usda},     {".usdc", write_mesh_usdc},
      {".usdz", write_mesh_usdz, true}};
  for (const MeshFormat& format : kFormats)
    if (file.extension() == format.ending) return format;
  throw UsageError(
      fmt::format("{}: meshes are written as .glb, .obj, .ply, .stl, .usda, .usdc or .usdz; "
                  "give the file one of these endings",
                  file.string()));
}

}  // namespace gs
