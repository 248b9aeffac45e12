// SPDX-License-Identifier: Apache-2.0
#include "gs_model/mesh/mesh_usd.h"

#include <algorithm>
#include <limits>

#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/glb/glb.h"
#include "gs_model/formats/usd/usd_prims.h"

namespace gs {
namespace {

/// The layer of a package with a texture: the mesh of its other layer, and what it looks like. The
/// light is in the colors already, which programs light again.
constexpr const char* kTexturedLayer = R"(#usda 1.0
(
    defaultPrim = "Scene"
    metersPerUnit = 1
    subLayers = [@mesh.usdc@]
    upAxis = "Y"
)

over "Scene"
{
    over "Mesh" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        rel material:binding = </Scene/Looks/Surface>
    }

    def Scope "Looks"
    {
        def Material "Surface"
        {
            token outputs:surface.connect = </Scene/Looks/Surface/Preview.outputs:surface>

            def Shader "Preview"
            {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor.connect = </Scene/Looks/Surface/Texture.outputs:rgb>
                float inputs:roughness = 1
                token outputs:surface
            }

            def Shader "Texture"
            {
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @texture.png@
                token inputs:sourceColorSpace = "sRGB"
                float2 inputs:st.connect = </Scene/Looks/Surface/Places.outputs:result>
                token inputs:wrapS = "clamp"
                token inputs:wrapT = "clamp"
                float3 outputs:rgb
            }

            def Shader "Places"
            {
                uniform token info:id = "UsdPrimvarReader_float2"
                string inputs:varname = "st"
                float2 outputs:result
            }
        }
    }
}
)";

std::vector<float> turned(const std::vector<Vec3f>& vectors) {
  std::vector<float> numbers;
  numbers.reserve(3 * vectors.size());
  for (const Vec3f& v : vectors)
    for (int axis = 0; axis < 3; ++axis) numbers.push_back(v[axis] * kHalfTurnZ[axis]);
  return numbers;
}

UsdValue extent_of_points(const std::vector<float>& points) {
  constexpr float kMost = std::numeric_limits<float>::max();
  UsdValue extent{"float3[]", {kMost, kMost, kMost, -kMost, -kMost, -kMost}};
  for (std::size_t i = 0; i < points.size(); ++i) {
    extent.floats[i % 3] = std::min(extent.floats[i % 3], points[i]);
    extent.floats[3 + i % 3] = std::max(extent.floats[3 + i % 3], points[i]);
  }
  return extent;
}

UsdPrim mesh_prim(const TriangleMesh& mesh, const Vec3d& world_offset, bool has_texture) {
  UsdPrim prim{"Mesh", "Mesh"};
  const auto add = [&](const char* name, UsdValue value, bool is_uniform = false) {
    prim.attributes.push_back({name, std::move(value), is_uniform});
  };
  const auto of_vertices = [&](const char* name, const char* type, std::vector<float> numbers) {
    UsdValue value{type, std::move(numbers)};
    value.interpolation = "vertex";
    add(name, std::move(value));
  };
  std::vector<double> indices;
  indices.reserve(3 * mesh.triangles.size());
  for (const Triangle& triangle : mesh.triangles)
    indices.insert(indices.end(), triangle.begin(), triangle.end());
  UsdValue points{"point3f[]", turned(mesh.vertices)};
  add("doubleSided", {"bool", {}, {1}}, true);
  add("extent", extent_of_points(points.floats));
  add("faceVertexCounts", {"int[]", {}, std::vector<double>(mesh.triangles.size(), 3)});
  add("faceVertexIndices", {"int[]", {}, std::move(indices)});
  of_vertices("normals", "normal3f[]", turned(mesh.normals));
  add("points", std::move(points));
  std::vector<float> looks;
  if (has_texture) {
    for (const Vec2f& place : mesh.texture_places)
      looks.insert(looks.end(), {place.x, 1 - place.y});
    of_vertices("primvars:st", "texCoord2f[]", std::move(looks));
  } else {
    for (const Rgb8& color : mesh.colors)
      for (const std::uint8_t channel : color) looks.push_back(linear_of(float(channel) / 255));
    of_vertices("primvars:displayColor", "color3f[]", std::move(looks));
  }
  add("subdivisionScheme", {"token", {}, {}, {"none"}}, true);
  add_world_offset(prim, world_offset);
  return prim;
}

UsdLayer mesh_layer(const TriangleMesh& mesh, const Vec3d& world_offset,
                    const std::vector<NamedView>& views, bool has_texture = false) {
  return usd_scene(mesh_prim(mesh, world_offset, has_texture), views);
}

}  // namespace

void write_mesh_usda(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                     const MeshTextureFile&, const std::vector<NamedView>& views) {
  write_usda(sink, mesh_layer(mesh, world_offset, views));
}

void write_mesh_usdc(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                     const MeshTextureFile&, const std::vector<NamedView>& views) {
  write_usdc(sink, mesh_layer(mesh, world_offset, views));
}

void write_mesh_usdz(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                     const MeshTextureFile& texture, const std::vector<NamedView>& views) {
  const bool has_texture = !texture.png.empty();
  MemorySink layer(sink.name());
  write_usdc(layer, mesh_layer(mesh, world_offset, views, has_texture));
  sink.write(has_texture ? usd_package({{"model.usda", kTexturedLayer},
                                        {"mesh.usdc", std::move(layer.text)},
                                        {"texture.png", texture.png}})
                         : usd_package({{"model.usdc", std::move(layer.text)}}));
}

}  // namespace gs
