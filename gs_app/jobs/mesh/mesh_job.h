// SPDX-License-Identifier: Apache-2.0
// The request of `gemsplat mesh`, and how the triangles of each kind are made.
#pragma once

#include <optional>
#include <string>

#include "gs_app/jobs/parts/job.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/wall_clock.h"
#include "gs_core/triangle_mesh.h"
#include "gs_model/formats/usd/usd.h"
#include "gs_render/fusion/depth_view.h"
#include "gs_render/fusion/volume.h"

namespace gs {

struct MeshJob : JobSettings {
  std::string model, output, cameras, depths, collision;  // with depths, `model` is a scene
  ModelChoice choice;
  std::optional<double> voxel, time;
  FusionRule rule;
  std::size_t components = 0, triangles = 0, views = 0, texture = 0;  // 0: not said
  bool is_agreed = false, force = false;
};

void visit_options(MeshJob& job, OptionList& list);
Outcome run(const MeshJob& job, JobEvents& events);

struct MadeMesh {
  TriangleMesh mesh;           // with colors, before it is cleaned
  float voxel = 0, pixel = 0;  // pixel: the median one on the surface; both in world units
  std::size_t views = 0;       // 0: of the model alone
  int views_divided_by = 1;    // both sides
  std::string model;           // that was read
  Vec3d world_offset{0.0};
  std::vector<DepthView> depth_views = {};  // for a texture
  std::vector<NamedView> named_views = {};  // that it was made of
};

/// The surface of a model as its cameras see it. Neither this nor mesh_by_opacity() says `model` and
/// `world_offset`.
MadeMesh mesh_by_views(const MeshJob& job, const OpenedModel& opened, const Config& config,
                       WallClock& clock, JobEvents& events);
/// That of the depth maps of a scene, in the colors of its photos.
MadeMesh mesh_by_depths(const MeshJob& job, const Config& config, WallClock& clock,
                        JobEvents& events);
/// A solid of the model alone.
MadeMesh mesh_by_opacity(const MeshJob& job, const OpenedModel& opened, WallClock& clock);

}  // namespace gs
