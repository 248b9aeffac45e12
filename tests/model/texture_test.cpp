// SPDX-License-Identifier: Apache-2.0
// Textures of meshes: charts, what is painted on them, and their files.
#include <map>
#include <set>

#include "gs_model/mesh/clean_mesh.h"
#include "gs_model/mesh/mesh_file.h"
#include "gs_model/mesh/mesh_read.h"
#include "gs_model/mesh/unwrap_mesh.h"
#include "gs_render/fusion/marching_cubes.h"
#include "gs_render/mesh/bake_texture.h"
#include "gs_render/mesh/draw_mesh.h"
#include "tests/support/error_of.h"
#include "tests/support/glb_parts.h"
#include "tests/support/surfaces.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test.h"

namespace gs {
namespace {

/// The unit sphere, closed, with colors and normals.
TriangleMesh coarse_sphere(std::uint32_t rings) {
  TriangleMesh mesh;
  const std::uint32_t around = 2 * rings;
  for (std::uint32_t r = 0; r <= rings; ++r)
    for (std::uint32_t i = 0; i < around; ++i) {
      const float polar = 3.14159265f * float(r) / float(rings);
      const float turn = 6.2831853f * float(i) / float(around);
      mesh.vertices.emplace_back(std::sin(polar) * std::cos(turn), std::cos(polar),
                                 std::sin(polar) * std::sin(turn));
    }
  for (std::uint32_t r = 0; r < rings; ++r)
    for (std::uint32_t i = 0; i < around; ++i) {
      const std::uint32_t a = r * around + i, b = r * around + (i + 1) % around;
      if (r > 0) mesh.triangles.push_back({a, b, a + around});
      if (r + 1 < rings) mesh.triangles.push_back({b, b + around, a + around});
    }
  mesh.colors.assign(mesh.vertices.size(), {10, 200, 30});
  compute_normals(mesh);
  return mesh;
}

/// How often each texel's middle lies in a triangle.
std::vector<int> uses_of_texels(const TriangleMesh& mesh) {
  std::vector<int> uses(mesh.texture.pixels.size() / 3, 0);
  for (const Triangle& t : mesh.triangles) {
    std::array<Vec2f, 3> at;
    for (std::size_t k = 0; k < 3; ++k)
      at[k] = {mesh.texture_places[t[k]].x * float(mesh.texture.width),
               mesh.texture_places[t[k]].y * float(mesh.texture.height)};
    const auto side = [&](std::size_t k, float x, float y) {
      const Vec2f &a = at[k], &b = at[(k + 1) % 3];
      return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
    };
    for (int y = 0; y < mesh.texture.height; ++y)
      for (int x = 0; x < mesh.texture.width; ++x) {
        const float px = float(x) + 0.5f, py = float(y) + 0.5f;
        const float a = side(0, px, py), b = side(1, px, py), c = side(2, px, py);
        const bool is_inside =
            (a > 1e-3f && b > 1e-3f && c > 1e-3f) || (a < -1e-3f && b < -1e-3f && c < -1e-3f);
        uses[std::size_t(y * mesh.texture.width + x)] += is_inside;
      }
  }
  return uses;
}

TEST(Texture, ChartsDoNotOverlapAndKeepTheSurface) {
  const TriangleMesh before = coarse_sphere(12);
  TriangleMesh mesh = before;
  const float texel = unwrap_mesh(mesh, {1024, 0.02f});
  EXPECT_FLOAT_EQ(texel, 0.02f);
  ASSERT_EQ(mesh.texture_places.size(), mesh.vertices.size());
  ASSERT_EQ(mesh.triangles.size(), before.triangles.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(mesh.vertices[mesh.triangles[t][k]], before.vertices[before.triangles[t][k]]);
      EXPECT_EQ(mesh.normals[mesh.triangles[t][k]], before.normals[before.triangles[t][k]]);
    }
  EXPECT_LE(mesh.texture.width, 512);
  for (const Vec2f& at : mesh.texture_places) {
    const float x = at.x * float(mesh.texture.width), y = at.y * float(mesh.texture.height);
    EXPECT_GE(std::min(x, y), float(kTextureGutter));
    EXPECT_LE(x, float(mesh.texture.width - kTextureGutter));
    EXPECT_LE(y, float(mesh.texture.height - kTextureGutter));
  }
  const std::vector<int> uses = uses_of_texels(mesh);
  EXPECT_EQ(*std::max_element(uses.begin(), uses.end()), 1);
  // Projections are smaller than the surface by the cosine, at most 55 degrees away.
  const double area = std::count(uses.begin(), uses.end(), 1) * double(texel) * double(texel);
  EXPECT_GT(area, 0.7 * 4 * 3.14159);
  EXPECT_LT(area, 4 * 3.14159);
}

TEST(Texture, IsCoarserWhereItWouldNotFit) {
  TriangleMesh mesh = coarse_sphere(12);
  const float texel = unwrap_mesh(mesh, {128, 0.001f});
  EXPECT_GT(texel, 0.02f);
  EXPECT_EQ(mesh.texture.width, 128);
  EXPECT_LE(mesh.texture.height, 128);
  const std::vector<int> uses = uses_of_texels(mesh);
  EXPECT_EQ(*std::max_element(uses.begin(), uses.end()), 1);
}

TEST(Texture, OfTooManyPartsIsRefused) {
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i < 1000; ++i) {
    for (const Vec3f& corner : {Vec3f(0), Vec3f(1, 0, 0), Vec3f(0, 1, 0)})
      mesh.vertices.push_back(corner + Vec3f(0, 0, float(i)));
    mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  mesh.colors.assign(mesh.vertices.size(), {0, 0, 0});
  compute_normals(mesh);
  EXPECT_NE(error_of([&] {
              unwrap_mesh(mesh, {128, 0.1f});
            }).find("--texture 256"),
            std::string::npos);
}

/// The color of a place on the sphere: stripes that are finer than the triangles below.
Vec3f stripes(const Vec3f& p) {
  return {0.5f + 0.5f * std::sin(12 * p.x), 0.5f + 0.5f * std::sin(10 * p.y), 0.5f};
}

/// Of six pictures of the sphere: the mean square of what they differ by from its stripes.
double error_of_pictures(const TriangleMesh& mesh) {
  double sum = 0;
  std::size_t count = 0;
  for (const Vec3f& direction : directions(6)) {
    const Camera camera = camera_from(direction);
    const ImageF picture = draw_mesh(mesh, camera, Vec3f(0)).color;
    for (int y = 0; y < kPictureSide; ++y)
      for (int x = 0; x < kPictureSide; ++x) {
        const Vec3f from = camera.position();
        const Vec3f ray = behind_pixel(camera, float(x) + 0.5f, float(y) + 0.5f, 1) - from;
        const float z = trace_sphere(from, ray);
        if (!(z < 0.98f * kDistance)) continue;  // the rim, where the coarse sphere ends
        const Vec3f color = stripes(from + z * ray);
        for (int c = 0; c < 3; ++c) sum += std::pow(picture.at(x, y, c) - color[c], 2);
        count += 3;
      }
  }
  return sum / double(count);
}

TEST(Texture, ShowsWhatIsFinerThanTriangles) {
  std::vector<DepthView> views = views_of(trace_sphere, directions(40));
  for (DepthView& view : views)
    for (int y = 0; y < kPictureSide; ++y)
      for (int x = 0; x < kPictureSide; ++x) {
        const DepthPicture picture = view.picture();
        if (!picture.has(x, y)) continue;
        const Vec3f color = stripes(picture.world_point(x, y));
        for (int c = 0; c < 3; ++c) view.color.at(x, y, c) = std::uint8_t(255 * color[c] + 0.5f);
      }
  constexpr float kVoxel = 0.04f;
  TriangleMesh mesh = coarse_sphere(10);
  color_vertices(views, kVoxel, mesh);
  const double by_vertices = error_of_pictures(mesh);
  TriangleMesh one = mesh;
  unwrap_mesh(mesh, {1024, 0.01f});
  bake_texture(views, kVoxel, kTextureGutter, mesh);
  const double by_texture = error_of_pictures(mesh);
  EXPECT_LT(by_texture, 0.01);  // rays meet the coarse sphere beside the true one
  EXPECT_GT(by_vertices, 5 * by_texture);
  unwrap_mesh(one, {1024, 0.01f});
  set_thread_count(1);
  bake_texture(views, kVoxel, kTextureGutter, one);
  set_thread_count(0);
  EXPECT_EQ(one.texture.pixels, mesh.texture.pixels);
}

TEST(Texture, HasTheColorsOfVerticesWhereNoViewSeesIt) {
  TriangleMesh mesh = coarse_sphere(8);
  unwrap_mesh(mesh, {256, 0.03f});
  bake_texture({}, 0.04f, kTextureGutter, mesh);
  const Rgb8 color = mesh.colors[0];
  std::set<Rgb8> found;
  for (std::size_t i = 0; i < mesh.texture.pixels.size(); i += 3)
    found.insert({mesh.texture.pixels[i], mesh.texture.pixels[i + 1], mesh.texture.pixels[i + 2]});
  EXPECT_EQ(found, (std::set<Rgb8>{color, {128, 128, 128}}));
}

/// What is in a file of the mesh.
std::string text_of_file(const std::string& ending, const TriangleMesh& mesh,
                         const MeshTextureFile& texture) {
  MemorySink sink("mesh" + ending);
  mesh_format_of("mesh" + ending).write(sink, mesh, Vec3d(0.0), texture, {});
  return sink.text;
}

TriangleMesh unwrapped_sphere() {
  TriangleMesh mesh = coarse_sphere(6);
  unwrap_mesh(mesh, {256, 0.05f});
  return mesh;
}

// As glTF 2.0 asks: each view within the buffer and aligned, indices of each list in range, as many
// rows of each attribute.
TEST(Texture, OfAGlbLiesInItsBuffer) {
  const TempFolder folder;
  const TriangleMesh mesh = unwrapped_sphere();
  const MeshTextureFile texture{"\x89PNG of 18 bytes??", ""};
  const std::string file = text_of_file(".glb", mesh, texture);
  EXPECT_EQ(file.size() % 4, 0u);
  EXPECT_EQ(load_little<std::uint32_t>(&file[8]), file.size());
  const GlbParts parts = glb_parts(file);
  const Json& json = parts.json;
  EXPECT_EQ(json["buffers"][0]["byteLength"], parts.binary.size());
  for (const Json& view : json["bufferViews"]) {
    EXPECT_EQ(view["byteOffset"].get<std::size_t>() % 4, 0u);
    EXPECT_LE(view["byteOffset"].get<std::size_t>() + view["byteLength"].get<std::size_t>(),
              parts.binary.size());
  }
  const Json& attributes = json["meshes"][0]["primitives"][0]["attributes"];
  EXPECT_FALSE(attributes.contains("COLOR_0"));
  for (const auto& [name, accessor] : attributes.items())
    EXPECT_EQ(json["accessors"][accessor.get<std::size_t>()]["count"], mesh.vertices.size());
  EXPECT_EQ(json["accessors"][2]["type"], "VEC2");
  const Json& use = json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
  const Json& source = json["textures"][use["index"].get<std::size_t>()];
  EXPECT_LT(source["sampler"], json["samplers"].size());
  const Json& image = json["images"][source["source"].get<std::size_t>()];
  EXPECT_EQ(image["mimeType"], "image/png");
  const Json& view = json["bufferViews"][image["bufferView"].get<std::size_t>()];
  EXPECT_EQ(parts.binary.substr(view["byteOffset"], view["byteLength"]), texture.png);
  EXPECT_FALSE(view.contains("target"));

  write_bytes(folder.path() / "mesh.glb", file);
  const MeshOfFile read = read_mesh(folder.path() / "mesh.glb");
  EXPECT_EQ(read.texture_png, texture.png);
  EXPECT_EQ(read.mesh.texture_places, mesh.texture_places);
  EXPECT_EQ(read.mesh.vertices, mesh.vertices);

  GlbParts damaged = parts;
  damaged.json["images"][0]["bufferView"] = 99;
  write_bytes(folder.path() / "mesh.glb", glb_file_of(damaged));
  EXPECT_NE(error_of([&] { read_mesh(folder.path() / "mesh.glb"); }).find("bufferViews"),
            std::string::npos);
}

TEST(Texture, OfAnObjIsNamedByItsMaterial) {
  const TempFolder folder;
  const TriangleMesh mesh = unwrapped_sphere();
  const MeshTextureFile texture{"png", "head"};
  const std::string file = text_of_file(".obj", mesh, texture);
  EXPECT_EQ(file.find("mtllib head.mtl\nusemtl surface\nv "), 0u);
  EXPECT_NE(texture.material().find("newmtl surface\n"), std::string::npos);
  EXPECT_NE(texture.material().find("map_Kd head.png\n"), std::string::npos);
  std::map<std::string, std::size_t> lines;
  std::istringstream text(file);
  for (std::string line; std::getline(text, line);) ++lines[line.substr(0, line.find(' '))];
  EXPECT_EQ(lines["v"], mesh.vertices.size());
  EXPECT_EQ(lines["vn"], mesh.vertices.size());
  EXPECT_EQ(lines["vt"], mesh.vertices.size());
  EXPECT_EQ(lines["f"], mesh.triangles.size());
  const Triangle& first = mesh.triangles[0];
  EXPECT_NE(file.find("\nf " + std::to_string(first[0] + 1) + "/" + std::to_string(first[0] + 1) +
                      "/" + std::to_string(first[0] + 1) + " "),
            std::string::npos);
  write_bytes(folder.path() / "mesh.obj", file);
  EXPECT_EQ(read_mesh(folder.path() / "mesh.obj").mesh.triangles, mesh.triangles);
}

}  // namespace
}  // namespace gs
