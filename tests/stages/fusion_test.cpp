// SPDX-License-Identifier: Apache-2.0
// Surfaces of known things: their meshes are closed, where they should be, and lie on them.
#include <map>

#include "gs_core/threads/parallel.h"
#include "gs_render/fusion/fusion.h"
#include "gs_render/fusion/marching_cubes.h"
#include "gs_render/fusion/solid_volume.h"
#include "gs_render/fusion/surface_depth.h"
#include "gs_render/renderer.h"
#include "gs_render/surface_renderer.h"
#include "tests/support/surfaces.h"

namespace gs {
namespace {

const Vec3f kHalfBox{0.8f, 0.6f, 0.5f};
float trace_box(const Vec3f& from, const Vec3f& ray) {
  float enter = 0, leave = kFar;
  for (int axis = 0; axis < 3; ++axis) {
    const float a = (-kHalfBox[axis] - from[axis]) / ray[axis],
                b = (kHalfBox[axis] - from[axis]) / ray[axis];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter < leave ? enter : kFar;
}

TriangleMesh mesh_of(const std::vector<DepthView>& views, float voxel, bool is_watertight) {
  Fusion fusion({4, is_watertight});
  for (const DepthView& view : views) fusion.add(view);
  return surface_of(fusion.fuse(fusion.frame(voxel)));
}

struct EdgeCounts {
  std::size_t open = 0, wrong = 0,
              all = 0;  // with one triangle, with more than two or the same way
};
EdgeCounts edges_of(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) ++uses[{t[k], t[(k + 1) % 3]}];
  EdgeCounts counts;
  for (const auto& [edge, count] : uses) {
    const bool has_twin = uses.contains({edge.second, edge.first});
    counts.open += !has_twin;
    counts.wrong += count > 1;
    counts.all += !has_twin || edge.first < edge.second;
  }
  return counts;
}

void expect_closed(const TriangleMesh& mesh) {
  const EdgeCounts counts = edges_of(mesh);
  EXPECT_GT(counts.all, 0u);
  EXPECT_EQ(counts.open, 0u);
  EXPECT_EQ(counts.wrong, 0u);
}

/// Positive where triangles run counterclockwise from outside.
double volume_in(const TriangleMesh& mesh) {
  double volume = 0;
  for (const Triangle& t : mesh.triangles)
    volume +=
        double(inner(mesh.vertices[t[0]], cross(mesh.vertices[t[1]], mesh.vertices[t[2]]))) / 6;
  return volume;
}

/// The mean distance of vertices from the unit sphere.
double error_of_sphere(const TriangleMesh& mesh) {
  double sum = 0;
  for (const Vec3f& vertex : mesh.vertices) sum += std::abs(double(length(vertex)) - 1);
  return sum / double(mesh.vertices.size());
}

/// The largest distance of points of the truth from the vertices.
float completeness(const TriangleMesh& mesh, const std::vector<Vec3f>& truth) {
  float most = 0;
  for (const Vec3f& point : truth) {
    float least = kFar;
    for (const Vec3f& vertex : mesh.vertices) least = std::min(least, length(vertex - point));
    most = std::max(most, least);
  }
  return most;
}

// Cells with every combination of neighbors are among these.
TEST(Fusion, SurfacesOfAnySignsAreClosedAndEachEdgeHasTwoTriangles) {
  Draws draws(3);
  Volume volume;
  volume.frame = {Vec3f(0), 1, {3, 3, 3}};
  for (std::uint64_t key = 0; key < volume.frame.count(); ++key) volume.keys.push_back(key);
  volume.distance.assign(27 * kBlockVoxels, 1);
  const std::size_t middle = volume.frame.key(1, 1, 1);
  for (int v = 0; v < kBlockVoxels; ++v)
    volume.distance[middle * kBlockVoxels + std::size_t(v)] = draws.uniform(-1, 1);
  const TriangleMesh mesh = surface_of(volume);
  expect_closed(mesh);
  EXPECT_GT(volume_in(mesh), 0);
}

TEST(Fusion, EveryCellCutsEachCrossedEdgeIntoOnePolygon) {
  for (unsigned solid = 0; solid < 256; ++solid) {
    std::map<int, int> corners;
    for (const auto& triangle : cell_triangles(solid))
      for (const int edge : triangle) ++corners[edge];
    std::size_t crossed = 0;
    for (unsigned c = 0; c < 8; ++c)
      for (const unsigned bit : {1u, 2u, 4u})
        crossed += !(c & bit) && (solid >> c & 1) != (solid >> (c | bit) & 1);
    EXPECT_EQ(corners.size(), crossed) << solid;
  }
}

TEST(Fusion, ASphereIsWhereItWasAndClosed) {
  const auto views = views_of(trace_sphere, directions(40));
  const float voxel = 0.04f;
  const TriangleMesh mesh = mesh_of(views, voxel, false);
  expect_closed(mesh);
  EXPECT_EQ(long(mesh.vertices.size()) - long(edges_of(mesh).all) + long(mesh.triangles.size()), 2);
  EXPECT_LT(error_of_sphere(mesh), 0.1 * voxel);
  EXPECT_LT(completeness(mesh, directions(500)), voxel);
  EXPECT_NEAR(volume_in(mesh), 4.18879, 0.04);
}

TEST(Fusion, ABoxIsWhereItWas) {
  const float voxel = 0.04f;
  const TriangleMesh mesh = mesh_of(views_of(trace_box, directions(40)), voxel, false);
  double sum = 0;
  for (const Vec3f& vertex : mesh.vertices) {
    const Vec3f out(std::abs(vertex.x) - kHalfBox.x, std::abs(vertex.y) - kHalfBox.y,
                    std::abs(vertex.z) - kHalfBox.z);
    sum += std::abs(std::max({out.x, out.y, out.z}));
  }
  EXPECT_LT(sum / double(mesh.vertices.size()), 0.15 * voxel);  // edges are rounded off
  std::vector<Vec3f> truth;
  for (const Vec3f& d : directions(300)) {
    const float reach = std::max(
        {std::abs(d.x) / kHalfBox.x, std::abs(d.y) / kHalfBox.y, std::abs(d.z) / kHalfBox.z});
    truth.push_back(d / reach);
  }
  EXPECT_LT(completeness(mesh, truth), 1.5f * voxel);
}

TEST(Fusion, MemoryIsForecastAlsoForVoxelsThatAreNotCounted) {
  Fusion fusion({}), closed({4, true});
  for (const DepthView& view : views_of(trace_sphere, directions(20)))
    fusion.add(view), closed.add(view);
  const VolumeForecast coarse = fusion.forecast(0.04f);
  const double blocks = double(fusion.surface_blocks(fusion.frame(0.02f)).size());
  const double bytes_of_block = coarse.bytes_at(0.04) / coarse.blocks;
  EXPECT_NEAR(coarse.bytes_at(0.02) / bytes_of_block / blocks, 1.2, 0.3);  // rather too many
  // Finer than a pixel, blocks are not counted one by one.
  EXPECT_FLOAT_EQ(float(fusion.forecast(1e-6f).voxel), fusion.median_pixel());
  EXPECT_GT(closed.forecast(1e-6f).bytes_at(1e-6), 1e15);
}

// From above alone, the lower half is not seen.
TEST(Fusion, WatertightClosesWhatNoViewSees) {
  std::vector<Vec3f> above = directions(40);
  std::erase_if(above, [](const Vec3f& d) { return d.y < 0.3f; });
  const auto views = views_of(trace_sphere, above);
  EXPECT_GT(edges_of(mesh_of(views, 0.05f, false)).open, 0u);
  const TriangleMesh closed = mesh_of(views, 0.05f, true);
  expect_closed(closed);
  EXPECT_GT(volume_in(closed), 2.1);  // more than half of the sphere
}

TEST(Fusion, ThreadsDoNotChangeABit) {
  const auto views = views_of(trace_box, directions(20));
  for (const bool is_watertight : {false, true}) {
    set_thread_count(1);
    const TriangleMesh one = mesh_of(views, 0.05f, is_watertight);
    set_thread_count(4);
    const TriangleMesh four = mesh_of(views, 0.05f, is_watertight);
    set_thread_count(0);
    EXPECT_EQ(one.vertices, four.vertices);
    EXPECT_EQ(one.triangles, four.triangles);
  }
}

// One view has a wall in front of the sphere, and another one knows nothing.
TEST(Fusion, OneWrongViewAndOneWithoutDepthChangeNothingMuch) {
  std::vector<DepthView> views = views_of(trace_sphere, directions(40));
  for (int y = 20; y < 40; ++y)
    for (int x = 20; x < 40; ++x) views[7].inverse_depth.at(x, y, 0) = 1 / 1.5f;
  std::fill(views[9].inverse_depth.pixels.begin(), views[9].inverse_depth.pixels.end(),
            kUnknownDepth);
  const TriangleMesh mesh = mesh_of(views, 0.05f, false);
  for (const Vec3f& vertex : mesh.vertices) EXPECT_NEAR(length(vertex), 1, 0.05f);
  expect_closed(mesh);
}

TEST(Fusion, VerticesHaveTheColorsOfTheViewsThatSeeThem) {
  std::vector<DepthView> views = views_of(trace_sphere, {Vec3f(0, 0, -1), Vec3f(0.1f, 0, -0.995f)});
  TriangleMesh mesh;
  mesh.vertices = {Vec3f(0, 0, -1), Vec3f(0, 0, 1)};
  const std::vector<char> is_seen = color_vertices(views, 0.05f, mesh);
  EXPECT_EQ(mesh.colors[0], (Rgb8{77, 77, 77}));
  EXPECT_EQ(is_seen, (std::vector<char>{1, 0}));
}

// The depth of surface_renderer.h lies between floating Gaussians and the surface.
TEST(Fusion, AModelIsMeshedWhereItsOpaqueGaussiansAre) {
  const Gaussians model = sphere_of_gaussians();
  const auto renderer = make_scalar_renderer();
  SurfaceRenderer mean_depth(*renderer, model.span(), model, {});
  RenderPass pass;
  std::vector<DepthView> views, views_of_means;
  for (const Vec3f& direction : directions(40)) {
    const Camera camera = camera_from(direction);
    renderer->forward(model.span(), camera, {}, pass);
    views.push_back(depth_view(camera, surface_inverse_depth(pass, model.span(), camera, {}),
                               renderer->picture_of(pass)));
    ImageF inverse = mean_depth.depth(camera);
    for (float& value : inverse.pixels) value = value > 0 ? 1 / value : kOpenPixel;
    views_of_means.push_back(depth_view(camera, inverse, renderer->picture_of(pass)));
  }
  const float voxel = 0.04f;
  const TriangleMesh mesh = mesh_of(views, voxel, false);
  EXPECT_LT(error_of_sphere(mesh), 0.25 * voxel);
  EXPECT_LT(completeness(mesh, directions(500)), voxel);
  EXPECT_LT(error_of_sphere(mesh), 0.5 * error_of_sphere(mesh_of(views_of_means, voxel, false)));
}

/// A flat, opaque Gaussian in a plane through (0, 0, 2), whose normal is tilted, and others.
class SplatDepth : public ::testing::Test {
 protected:
  SplatDepth() : camera_(plain_camera(64, 64)) {
    camera_.cx = camera_.cy = 32;
    settings_.antialias = true;  // less blur in the splat
  }
  Gaussians tilted(std::size_t count) const {
    Gaussians all(count, host_memory());
    set_gaussian(all, 0, {0, 0, 2}, 0.4f, 0.995f);
    all.log_scale[0].z = std::log(1e-4f);
    all.rotation[0] = {std::cos(0.25f), std::sin(0.25f), 0, 0};  // half a radian about x
    return all;
  }
  float depth_at(const Gaussians& gaussians, int x, int y) {
    make_scalar_renderer()->forward(gaussians.span(), camera_, settings_, pass_);
    return 1 / surface_inverse_depth(pass_, gaussians.span(), camera_, settings_).at(x, y, 0);
  }
  Camera camera_;
  RenderSettings settings_;
  RenderPass pass_;
};

TEST_F(SplatDepth, OfAFlatGaussianIsThatOfItsPlane) {
  const Gaussians one = tilted(1);
  const float tilt = std::tan(0.5f);
  for (const int y : {26, 32, 38}) {
    const float v = (float(y) + 0.5f - 32) / 64;  // plane: z - 2 = tilt y, y = v z
    EXPECT_NEAR(depth_at(one, 32, y), 2 / (1 - tilt * v), 2e-3f) << y;
  }
}

TEST_F(SplatDepth, DoesNotMoveByWhatIsInFrontOrBehind) {
  Gaussians all = tilted(3);
  set_gaussian(all, 1, {0, 0, 1}, 0.3f, 0.3f);
  set_gaussian(all, 2, {0, 0, 8}, 3, 0.9f);
  EXPECT_NEAR(depth_at(all, 32, 32), depth_at(tilted(1), 32, 32), 1e-5f);
}

// Of two disks that let half of the light through, one behind the other within the window, the first
// counts eight times as much: its weight is .5 and not .25, and the light that reaches it 1 and not .5.
TEST_F(SplatDepth, IsThatOfTheFrontOfASurface) {
  Gaussians disks(2, host_memory());
  for (const int i : {0, 1}) {
    set_gaussian(disks, i, {0, 0, i == 0 ? 2 : 2.01f}, 1, 0.5f);
    disks.log_scale[i].z = std::log(1e-4f);
  }
  const float o = (8 / 2.0f + 1 / 2.01f) / 9;
  EXPECT_NEAR(depth_at(disks, 32, 32), 1 / o, 2e-5f);
}

TEST_F(SplatDepth, SaysWhatIsOpenAndWhatIsUnknown) {
  Gaussians faint(1, host_memory());
  set_gaussian(faint, 0, {0, 0, 2}, 0.2f, 0.4f);
  EXPECT_EQ(depth_at(faint, 32, 32), 1 / kUnknownDepth);
  EXPECT_EQ(depth_at(faint, 0, 0), 1 / kOpenPixel);
}

/// Opaque, round Gaussians.
Gaussians balls(const std::vector<Vec3f>& at, float size) {
  Gaussians all(at.size(), host_memory());
  for (std::size_t i = 0; i < at.size(); ++i) set_gaussian(all, i, at[i], size, 0.95f);
  return all;
}
TriangleMesh solid_of(const Gaussians& gaussians, float voxel, SolidFill fill) {
  return surface_of(solid_volume(gaussians, solid_frame(gaussians, voxel), fill));
}
long euler_number(const TriangleMesh& mesh) {
  return long(mesh.vertices.size()) - long(edges_of(mesh).all) + long(mesh.triangles.size());
}

TEST(Solid, AHollowBallIsOneSolid) {
  const TriangleMesh mesh = solid_of(sphere_of_gaussians(), 0.05f, SolidFill::inside);
  expect_closed(mesh);
  EXPECT_EQ(euler_number(mesh), 2);        // one piece without a hole, and nothing within
  EXPECT_LT(volume_in(mesh), 1.2 * 4.19);  // the wall is some voxels thick
  EXPECT_GT(volume_in(mesh), 4.19);
  EXPECT_LT(completeness(mesh, directions(500)), 2 * 0.05f);
}

// Thin walls, also between two rows of voxels.
TEST(Solid, WallsThinnerThanAVoxelHaveNoHoles) {
  for (const float shift : {0.0f, 0.02f, 0.04f, 0.06f}) {
    Gaussians wall = sphere_of_gaussians();
    for (std::size_t i = 0; i < wall.count(); ++i) wall.mean[i].x += shift;
    const TriangleMesh mesh = solid_of(wall, 0.08f, SolidFill::inside);
    expect_closed(mesh);
    EXPECT_EQ(euler_number(mesh), 2);
  }
}

// A box that one is inside of, and a ball in it.
std::vector<Vec3f> room() {
  std::vector<Vec3f> at;
  for (int i = -10; i <= 10; ++i)
    for (int j = -10; j <= 10; ++j)
      for (const float side : {-1.0f, 1.0f}) {
        const float a = 0.1f * float(i), b = 0.1f * float(j);
        at.insert(at.end(), {Vec3f(side, a, b), Vec3f(a, side, b), Vec3f(a, b, side)});
      }
  return at;
}

TEST(Solid, ARoomIsAHoleInASolid) {
  std::vector<Vec3f> at = room();
  at.emplace_back(0.6f, 0.5f, 0.5f);
  const Gaussians gaussians = balls(at, 0.07f);
  const TriangleMesh mesh = solid_of(gaussians, 0.05f, SolidFill::outside);
  expect_closed(mesh);
  EXPECT_EQ(euler_number(mesh), 6);  // the outside, the room, and what is in it
  const VolumeFrame frame = solid_frame(gaussians, 0.05f);
  double box = 1;
  for (const std::uint64_t blocks : frame.blocks) box *= 0.05 * 8 * double(blocks - 2);
  EXPECT_NEAR(volume_in(mesh), box - 1.75 * 1.75 * 1.75, 0.06 * box);
  std::erase_if(at, [](const Vec3f& p) { return p.y < -0.9f; });  // no ceiling
  EXPECT_THROW(solid_of(balls(at, 0.07f), 0.05f, SolidFill::outside), Error);
}

TEST(Solid, WhatIsBelowTheFloorIsSolid) {
  std::vector<Vec3f> at;
  for (int i = -10; i <= 10; ++i)
    for (int j = -10; j <= 10; ++j)
      at.emplace_back(0.1f * float(i), i > 0 ? 0.0f : 0.5f, 0.1f * float(j));  // a step
  const TriangleMesh mesh = solid_of(balls(at, 0.07f), 0.05f, SolidFill::floor);
  expect_closed(mesh);
  EXPECT_EQ(euler_number(mesh), 2);
  float lowest = 0;
  for (const Vec3f& vertex : mesh.vertices) lowest = std::max(lowest, vertex.y);
  EXPECT_GT(lowest, 0.5f);
  EXPECT_GT(volume_in(mesh), 0.5);  // below the upper half of the step
  EXPECT_GT(volume_in(mesh), 1.5 * volume_in(solid_of(balls(at, 0.07f), 0.05f, SolidFill::inside)));
}

TEST(Solid, IsTheSameForAnyThreadsAndNothingWithoutGaussians) {
  const Gaussians model = sphere_of_gaussians();
  set_thread_count(1);
  const TriangleMesh one = solid_of(model, 0.06f, SolidFill::inside);
  set_thread_count(4);
  const TriangleMesh four = solid_of(model, 0.06f, SolidFill::inside);
  set_thread_count(0);
  EXPECT_EQ(one.vertices, four.vertices);
  EXPECT_EQ(one.triangles, four.triangles);
  EXPECT_THROW(solid_frame(balls({}, 1), 0), Error);
}

// A wall that one view alone imagines goes, and what several views see stays; where all look
// through, nothing is doubtful.
TEST(Fusion, ForgetsWhatASingleViewSees) {
  std::vector<DepthView> views = views_of(trace_sphere, directions(40));
  const DepthView before = views[7];
  for (int y = 20; y < 40; ++y)
    for (int x = 20; x < 40; ++x) views[7].inverse_depth.at(x, y, 0) = 1 / 1.5f;
  Fusion fusion({});
  for (const DepthView& view : views) fusion.add(view);
  fusion.drop_doubtful();
  std::size_t surface = 0, forgotten = 0;
  for (std::size_t v = 0; v < views.size(); ++v)
    for (int y = 0; y < kPictureSide; ++y)
      for (int x = 0; x < kPictureSide; ++x) {
        const float o = fusion.views()[v].inverse_depth.at(x, y, 0);
        const float was = views[v].inverse_depth.at(x, y, 0);
        if (v == 7 && x >= 20 && x < 40 && y >= 20 && y < 40) {
          EXPECT_EQ(o, kUnknownDepth);
          continue;
        }
        EXPECT_TRUE(o == was || (was > 0 && o == kUnknownDepth));
        surface += was > 0;
        forgotten += o != was;
      }
  EXPECT_LT(double(forgotten), 0.01 * double(surface));
  Fusion alone({});
  alone.add(before);
  alone.drop_doubtful();  // nothing could agree
  EXPECT_EQ(alone.views()[0].inverse_depth.pixels, before.inverse_depth.pixels);
}

}  // namespace
}  // namespace gs
