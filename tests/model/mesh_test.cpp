// SPDX-License-Identifier: Apache-2.0
// Files of meshes say what the mesh is, and small pieces go.
#include <sstream>

#include "gs_core/geometry/vectors.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/glb/glb.h"
#include "gs_model/formats/usd/usd_layer.h"
#include "gs_model/mesh/clean_mesh.h"
#include "gs_model/mesh/decimate_mesh.h"
#include "gs_model/mesh/mesh_file.h"
#include "gs_model/mesh/mesh_read.h"
#include "tests/support/error_of.h"
#include "tests/support/glb_parts.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test.h"

namespace gs {
namespace {

/// A tetrahedron at `at`, outwards.
void add_tetrahedron(TriangleMesh& mesh, const Vec3f& at) {
  const auto first = std::uint32_t(mesh.vertices.size());
  for (const Vec3f& corner : {Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0), Vec3f(0, 0, 1)}) {
    mesh.vertices.push_back(at + corner);
    mesh.colors.push_back({255, 128, std::uint8_t(mesh.vertices.size())});
  }
  for (const Triangle& t : {Triangle{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}})
    mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
}

TriangleMesh tetrahedron() {
  TriangleMesh mesh;
  add_tetrahedron(mesh, {1, 2, 3});
  compute_normals(mesh);
  return mesh;
}

std::string file_of(const std::string& ending, const TriangleMesh& mesh,
                    const Vec3d& offset = Vec3d(0.0), const MeshTextureFile& texture = {},
                    const std::vector<NamedView>& views = {}) {
  MemorySink sink("mesh" + ending);
  mesh_format_of("mesh" + ending).write(sink, mesh, offset, texture, views);
  return sink.text;
}

TEST(Mesh, NormalsPointOutwards) {
  const TriangleMesh mesh = tetrahedron();
  const Vec3f center = mesh.vertices[0] + Vec3f(0.25f);
  for (std::size_t v = 0; v < 4; ++v) {
    EXPECT_GT(inner(mesh.normals[v], mesh.vertices[v] - center), 0);
    EXPECT_NEAR(length(mesh.normals[v]), 1, 1e-6);
  }
}

TEST(Mesh, SmallPiecesAndUnusedVerticesGo) {
  TriangleMesh mesh;
  mesh.vertices = {Vec3f(9)};
  mesh.colors = {{9, 9, 9}};
  for (int i = 0; i < 3; ++i) add_tetrahedron(mesh, Vec3f(float(3 * i)));
  mesh.triangles.pop_back();  // the last one has three triangles
  TriangleMesh usual = mesh;
  EXPECT_EQ(keep_large_pieces(mesh, 2), 2u);
  EXPECT_EQ(mesh.triangles.size(), 8u);
  ASSERT_EQ(mesh.vertices.size(), 8u);
  EXPECT_EQ(mesh.vertices[0], Vec3f(0));
  EXPECT_EQ(mesh.colors[4][2], 6);
  EXPECT_EQ(keep_large_pieces(usual, 0), 1u);  // none has 50 triangles: the first one stays
  EXPECT_EQ(usual.triangles.size(), 4u);
}

/// How often each edge is used, in each direction.
std::map<std::pair<std::uint32_t, std::uint32_t>, int> directed_edges(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) ++uses[{t[k], t[(k + 1) % 3]}];
  return uses;
}

/// A sphere of rings, closed.
TriangleMesh ball(std::uint32_t rings, std::uint32_t around) {
  TriangleMesh mesh;
  mesh.vertices = {Vec3f(0, 0, 1)};
  for (std::uint32_t r = 1; r < rings; ++r)
    for (std::uint32_t i = 0; i < around; ++i) {
      const float polar = 3.14159265f * float(r) / float(rings);
      const float turn = 6.2831853f * float(i) / float(around);
      mesh.vertices.emplace_back(std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn),
                                 std::cos(polar));
    }
  mesh.vertices.emplace_back(0, 0, -1);
  const auto last = std::uint32_t(mesh.vertices.size() - 1);
  const auto at = [&](std::uint32_t r, std::uint32_t i) {
    return 1 + (r - 1) * around + i % around;
  };
  for (std::uint32_t i = 0; i < around; ++i) {
    mesh.triangles.push_back({0, at(1, i), at(1, i + 1)});
    for (std::uint32_t r = 1; r + 1 < rings; ++r) {
      mesh.triangles.push_back({at(r, i), at(r + 1, i), at(r + 1, i + 1)});
      mesh.triangles.push_back({at(r, i), at(r + 1, i + 1), at(r, i + 1)});
    }
    mesh.triangles.push_back({at(rings - 1, i), last, at(rings - 1, i + 1)});
  }
  return mesh;
}

TEST(Mesh, ADecimatedBallStaysABallAndClosed) {
  TriangleMesh mesh = ball(40, 60);
  decimate_mesh(mesh, 600);
  EXPECT_LE(mesh.triangles.size(), 600u);
  EXPECT_GT(mesh.triangles.size(), 590u);
  const auto edges = directed_edges(mesh);
  for (const auto& [edge, count] : edges)
    EXPECT_TRUE(count == 1 && edges.contains({edge.second, edge.first}));
  for (const Vec3f& vertex : mesh.vertices) EXPECT_NEAR(length(vertex), 1, 0.02);
  for (const Triangle& t : mesh.triangles)
    EXPECT_GT(length(mesh.vertices[t[0]] + mesh.vertices[t[1]] + mesh.vertices[t[2]]) / 3, 0.95f);
}

TEST(Mesh, DecimationLeavesThePlaneAndTheBorderOfASquare) {
  TriangleMesh mesh;
  constexpr std::uint32_t kSide = 20;
  for (std::uint32_t y = 0; y <= kSide; ++y)
    for (std::uint32_t x = 0; x <= kSide; ++x) mesh.vertices.emplace_back(float(x), float(y), 0);
  for (std::uint32_t y = 0; y < kSide; ++y)
    for (std::uint32_t x = 0; x < kSide; ++x) {
      const std::uint32_t a = y * (kSide + 1) + x, b = a + kSide + 1;
      mesh.triangles.push_back({a, a + 1, b + 1});
      mesh.triangles.push_back({a, b + 1, b});
    }
  decimate_mesh(mesh, 40);
  EXPECT_LE(mesh.triangles.size(), 40u);
  float area = 0;
  for (const Triangle& t : mesh.triangles)
    area += 0.5f * cross(mesh.vertices[t[1]] - mesh.vertices[t[0]],
                         mesh.vertices[t[2]] - mesh.vertices[t[0]])
                       .z;
  EXPECT_NEAR(area, float(kSide * kSide), 1e-3);
}

TEST(Mesh, PlyHasVerticesColorsFacesAndTheWorldOffset) {
  const TriangleMesh mesh = tetrahedron();
  const std::string file = file_of(".ply", mesh, {1e6, 0, 0.5});
  const std::size_t body = file.find("end_header\n") + 11;
  EXPECT_NE(file.find("comment world_offset 1000000 0 0.5\n"), file.npos);
  EXPECT_NE(file.find("element vertex 4\n"), file.npos);
  EXPECT_NE(file.find("element face 4\n"), file.npos);
  ASSERT_EQ(file.size(), body + 4 * 27 + 4 * 13);
  EXPECT_EQ(load_little<Vec3f>(&file[body + 27]), mesh.vertices[1]);
  EXPECT_EQ(load_little<Rgb8>(&file[body + 27 + 24]), mesh.colors[1]);
  EXPECT_EQ(file[body + 4 * 27], 3);
  EXPECT_EQ(load_little<Triangle>(&file[body + 4 * 27 + 1]), mesh.triangles[0]);
}

TEST(Mesh, ObjCountsFromOne) {
  std::istringstream lines(file_of(".obj", tetrahedron()));
  std::map<std::string, std::vector<std::string>> by_word;
  for (std::string word, rest; lines >> word && std::getline(lines, rest);)
    by_word[word].push_back(rest);
  EXPECT_EQ(by_word["v"].size(), 4u);
  EXPECT_EQ(by_word["vn"].size(), 4u);
  EXPECT_EQ(by_word["v"][1], " 2 2 3 1.0000 0.5020 0.0078");
  EXPECT_EQ(by_word["f"][0], " 1//1 3//3 2//2");
  EXPECT_EQ(by_word["f"].size(), 4u);
}

TEST(Mesh, StlHasATriangleInFiftyBytes) {
  const TriangleMesh mesh = tetrahedron();
  const std::string file = file_of(".stl", mesh);
  ASSERT_EQ(file.size(), 84u + 4 * 50);
  EXPECT_EQ(load_little<std::uint32_t>(&file[80]), 4u);
  EXPECT_EQ(load_little<Vec3f>(&file[84]), Vec3f(0, 0, -1));
  EXPECT_EQ(load_little<Vec3f>(&file[96 + 12]), mesh.vertices[2]);
}

// As glTF 2.0 asks: ranges of positions, whole buffers, indices in range, linear colors.
TEST(Mesh, GlbIsATriangleMeshTurnedUpright) {
  const TriangleMesh mesh = tetrahedron();
  const GlbParts parts = glb_parts(file_of(".glb", mesh, {1, 2, 3}));
  const Json& accessors = parts.json["accessors"];
  EXPECT_EQ(accessors[0]["min"], Json::array({-2.0, -3.0, 3.0}));
  EXPECT_EQ(accessors[0]["max"], Json::array({-1.0, -2.0, 4.0}));
  EXPECT_EQ(parts.json["nodes"][0]["extras"]["world_offset"], Json::array({1.0, 2.0, 3.0}));
  EXPECT_EQ(parts.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"], 2);
  EXPECT_EQ(parts.json["buffers"][0]["byteLength"], parts.binary.size());
  const auto start = [&](std::size_t view) {
    return parts.json["bufferViews"][view]["byteOffset"].get<std::size_t>();
  };
  EXPECT_EQ(load_little<Vec3f>(&parts.binary[start(0)]), Vec3f(-1, -2, 3));
  EXPECT_EQ(std::uint8_t(parts.binary[start(2)]), 255);
  EXPECT_EQ(std::uint8_t(parts.binary[start(2) + 1]), 55);  // 128 of 255, linear
  EXPECT_EQ(load_little<Triangle>(&parts.binary[start(3)]), mesh.triangles[0]);
}

/// Colors as a .glb keeps them: in bytes of linear light.
std::vector<Rgb8> through_linear_bytes(std::vector<Rgb8> colors) {
  for (Rgb8& color : colors)
    for (std::uint8_t& channel : color)
      channel = std::uint8_t(
          to_unorm(srgb_of(from_unorm(to_unorm(linear_of(float(channel) / 255), 8), 8)), 8));
  return colors;
}

const UsdPrim& child_of(const std::vector<UsdPrim>& prims, const std::string& name) {
  for (const UsdPrim& prim : prims)
    if (prim.name == name) return prim;
  throw std::runtime_error("no prim " + name);
}

TEST(Mesh, UsdHasAMeshAndCamerasInOneStage) {
  const TriangleMesh mesh = tetrahedron();
  NamedView view{"a b.jpg", {}};
  view.camera.width = 40, view.camera.height = 30;
  view.camera.fx = view.camera.fy = 36, view.camera.cx = 20, view.camera.cy = 15;
  for (const bool is_text : {true, false}) {
    SCOPED_TRACE(is_text ? "text" : "bytes");
    const std::string bytes =
        file_of(is_text ? ".usda" : ".usdc", mesh, {500000, 0, 0.5}, {}, {view});
    const UsdLayer layer = is_text ? parse_usda("m.usda", bytes) : parse_usdc("m.usdc", bytes);
    ASSERT_EQ(layer.prims.size(), 1u);
    EXPECT_EQ(layer.up_axis, "Y");
    const UsdPrim& prim = child_of(layer.prims[0].children, "Mesh");
    EXPECT_EQ(prim.type, "Mesh");
    const UsdValue &points = *prim.find("points"), &normals = *prim.find("normals"),
                   &colors = *prim.find("primvars:displayColor");
    EXPECT_EQ(points.type, "point3f[]");
    EXPECT_EQ(normals.type, "normal3f[]");
    EXPECT_EQ(colors.type, "color3f[]");
    ASSERT_EQ(points.floats.size(), 12u);
    ASSERT_EQ(normals.floats.size(), 12u);
    ASSERT_EQ(colors.floats.size(), 12u);
    for (std::size_t v = 0; v < 4; ++v) {
      EXPECT_EQ(Vec3f(points.floats[3 * v], points.floats[3 * v + 1], points.floats[3 * v + 2]),
                mesh.vertices[v] * Vec3f(-1, -1, 1));
      EXPECT_EQ(normals.floats[3 * v + 1], -mesh.normals[v].y);
      EXPECT_NEAR(colors.floats[3 * v], 1, 1e-6f);
      EXPECT_NEAR(colors.floats[3 * v + 1], 0.2158605f, 1e-6f);  // 128 of a display, as light
    }
    const UsdValue &counts = *prim.find("faceVertexCounts"),
                   &indices = *prim.find("faceVertexIndices");
    EXPECT_EQ(counts.type, "int[]");
    EXPECT_EQ(counts.doubles, (std::vector<double>(4, 3)));
    EXPECT_EQ(indices.doubles, (std::vector<double>{0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3}));
    EXPECT_EQ(prim.find("extent")->floats, (std::vector<float>{-2, -3, 3, -1, -2, 4}));
    EXPECT_EQ(prim.find("subdivisionScheme")->words, (std::vector<std::string>{"none"}));
    EXPECT_EQ(prim.find("gemsplat:worldOffset")->doubles, (std::vector<double>{500000, 0, 0.5}));
    const UsdPrim& cameras = child_of(layer.prims[0].children, "Cameras");
    ASSERT_EQ(cameras.children.size(), 1u);
    EXPECT_EQ(cameras.children[0].name, "view_0_a_b_jpg");
    EXPECT_EQ(cameras.children[0].type, "Camera");
  }
  EXPECT_THAT(
      file_of(".usda", mesh),
      AllOf(HasSubstr("normal3f[] normals = ["),
            HasSubstr(" (\n            interpolation = \"vertex\"\n        )"),
            HasSubstr("uniform token subdivisionScheme = \"none\""), Not(HasSubstr("Cameras"))));
}

TEST(Mesh, UsdPackagesHaveAMaterialForATexture) {
  TriangleMesh mesh = tetrahedron();
  const std::string plain = file_of(".usdz", mesh);
  EXPECT_THAT(zip_entries("m.usdz", plain), testing::SizeIs(1));
  mesh.texture_places = {{0, 0}, {1, 0}, {0, 1}, {0.25f, 0.75f}};
  const std::string bytes = file_of(".usdz", mesh, Vec3d(0.0), {"a png", "mesh"});
  EXPECT_EQ(bytes.substr(30, 10), "model.usda") << "the first file is the layer to open";
  const auto entries = zip_entries("m.usdz", bytes);
  ASSERT_THAT(entries, testing::SizeIs(3));
  EXPECT_EQ(entries.at("texture.png"), "a png");
  EXPECT_EQ((entries.at("mesh.usdc").data() - bytes.data()) % 64, 0);
  const UsdLayer look = parse_usda("model.usda", entries.at("model.usda"));
  const UsdPrim& surface =
      child_of(child_of(look.prims.at(0).children, "Looks").children, "Surface");
  EXPECT_EQ(surface.type, "Material");
  EXPECT_EQ(surface.children.size(), 3u);
  const UsdLayer layer = parse_usdc("mesh.usdc", entries.at("mesh.usdc"));
  const UsdPrim& prim = child_of(layer.prims[0].children, "Mesh");
  EXPECT_EQ(prim.find("primvars:displayColor"), nullptr);
  EXPECT_EQ(prim.find("primvars:st")->type, "texCoord2f[]");
  EXPECT_EQ(prim.find("primvars:st")->floats,
            (std::vector<float>{0, 1, 1, 1, 0, 0, 0.25f, 0.25f}));  // from the lower left corner
}

TEST(Mesh, IsReadAsItWasWritten) {
  const TempFolder folder;
  const TriangleMesh mesh = tetrahedron();
  const Vec3d offset(1e6, 0, 0.5);
  for (const std::string ending : {".glb", ".obj", ".ply"}) {
    write_bytes(folder.path() / ("mesh" + ending), file_of(ending, mesh, offset));
    const MeshOfFile read = read_mesh(folder.path() / ("mesh" + ending));
    EXPECT_EQ(read.mesh.vertices, mesh.vertices) << ending;
    EXPECT_EQ(read.mesh.triangles, mesh.triangles) << ending;
    EXPECT_EQ(read.mesh.colors, ending == ".glb" ? through_linear_bytes(mesh.colors) : mesh.colors);
    EXPECT_EQ(read.world_offset, offset) << ending;
  }
  write_bytes(folder.path() / "mesh.stl", file_of(".stl", mesh));
  const TriangleMesh soup = read_mesh(folder.path() / "mesh.stl").mesh;
  ASSERT_EQ(soup.triangles.size(), mesh.triangles.size());
  for (std::size_t t = 0; t < soup.triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(soup.vertices[soup.triangles[t][k]], mesh.vertices[mesh.triangles[t][k]]);
}

TEST(Mesh, PolygonsOfTextAreReadAsFans) {
  const TempFolder folder;
  write_bytes(folder.path() / "a.obj",
              "o quad\nv 0 0 0\nv 1 0 0\nv 1 1 0 0.5 0.5 0.5\nvn 0 0 1\nv 0 1 0\n"
              "f 1/1/1 2//1 3 -1");  // without its last line's end
  write_bytes(folder.path() / "a.ply",
              "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\n"
              "property double z\nelement face 1\nproperty uchar red\n"
              "property list uchar int vertex_index\nend_header\n"
              "0 0 0\n1 0 0\n1 1 0\n0 1 0\n9 4 0 1 2 3\n");
  for (const char* name : {"a.obj", "a.ply"}) {
    const TriangleMesh mesh = read_mesh(folder.path() / name).mesh;
    EXPECT_EQ(mesh.vertices.size(), 4u);
    EXPECT_EQ(mesh.vertices[2], Vec3f(1, 1, 0));
    EXPECT_EQ(mesh.triangles, (std::vector<Triangle>{{0, 1, 2}, {0, 2, 3}})) << name;
  }
}

TEST(Mesh, DamagedFilesAreRefusedWithARemedy) {
  const TempFolder folder;
  const auto expect = [&](const std::string& name, const std::string& bytes,
                          const std::string& part) {
    write_bytes(folder.path() / name, bytes);
    const std::string error = error_of([&] { read_mesh(folder.path() / name); });
    EXPECT_NE(error.find(part), error.npos) << error;
    EXPECT_NE(error.find(name), error.npos) << error;
  };
  expect("a.obj", "f 1 2 3\n", "no vertex");
  expect("a.obj", "v 0 0 0\nf 1 2 -5\n", "not there");
  expect("a.obj", "v 0 x 0\n", "line 1");
  expect("a.obj", "v 0 nan 0\n", "not finite");
  expect("a.stl", "solid text\n", "binary .stl");
  expect("a.stl", file_of(".stl", tetrahedron()).substr(0, 200), "cut short");
  expect("a.ply", file_of(".ply", tetrahedron()).substr(0, 400), "impossible length");
  expect("a.glb", file_of(".glb", tetrahedron()).substr(0, 500), ".glb");
  std::string far = file_of(".ply", tetrahedron());
  far[far.size() - 1] = 1;  // the last corner
  expect("a.ply", far, "not there");
  expect("a.fbx", "", "read as .glb");
}

TEST(Mesh, OtherEndingsAreRefused) {
  EXPECT_THROW(mesh_format_of("mesh.fbx"), UsageError);
  EXPECT_THROW(mesh_format_of("mesh"), UsageError);
}

}  // namespace
}  // namespace gs
