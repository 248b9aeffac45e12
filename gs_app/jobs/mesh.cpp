// SPDX-License-Identifier: Apache-2.0
// gemsplat mesh: the surface of a trained model of any trainer, as triangles.
#include <spdlog/fmt/fmt.h>

#include "gs_app/export/export_model.h"
#include "gs_app/jobs/mesh/mesh_job.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/text.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_model/mesh/clean_mesh.h"
#include "gs_model/mesh/decimate_mesh.h"
#include "gs_model/mesh/mesh_file.h"

namespace gs {
namespace {

constexpr std::size_t kCollisionTriangles = 20000;

MadeMesh make(const MeshJob& job, WallClock& clock, JobEvents& events) {
  if (!job.depths.empty()) return mesh_by_depths(job, resolve_to_work(job), clock, events);
  OpenedModel opened = open_model(job.model, job.choice.step);
  if (job.time) take_moment(opened, *job.time);
  if (opened.model.gaussians.has_time)
    throw UsageError(opened.ply.string() + " moves; give the moment of the mesh with --time T");
  // A cameras.json has the size of its pictures already; only -r makes them smaller.
  if (!job.has("dataset.source")) opened.config.dataset.resolution = 1;
  const Config config = resolve_to_work(job, opened.config);
  MadeMesh made = job.collision.empty() ? mesh_by_views(job, opened, config, clock, events)
                                        : mesh_by_opacity(job, opened, clock);
  made.model = opened.ply.string();
  made.world_offset = opened.model.world_offset;
  return made;
}

}  // namespace

void visit_options(MeshJob& job, OptionList& list) {
  list("model", job.model, std::string(kModelHelp) + "; with --depths a scene")
      .takes("MODEL|RUN")
      .required();
  list("-o,--output", job.output,
       "mesh to write, whose name ends in .glb, .obj, .ply or .stl [beside the model: "
       "MODEL-mesh.glb]")
      .takes("FILE");
  model_options(list, job.choice);
  given_camera_options(list, job.cameras, "the training views of the run");
  const auto option = [&](const char* names, auto& value, const char* meaning) -> Option& {
    return list(names, value, meaning).group("Mesh");
  };
  option("--voxel", job.voxel,
         "size of the finest detail, in world units [1.5 pixels of the median view]")
      .takes("SIZE")
      .positive();
  option("--truncation", job.rule.truncation,
         "voxels before and behind a surface that it has a say about; more for noisy models [4]")
      .takes("VOXELS")
      .between(2, 32)
      .rare();
  option("--watertight", job.rule.is_watertight,
         "close the surface, for printing: space that no view sees through is solid");
  option(
      "--depths", job.depths,
      "fuse the depth maps in this folder, one for each photo of a scene, in its units: MODEL is "
      "the scene, and no model is read")
      .takes("FOLDER")
      .excludes("--cameras")
      .excludes("--data")
      .rare();
  option("--collision", job.collision,
         "a closed solid of 20,000 triangles from the model alone, without cameras, for games and "
         "robots; with which air: inside hollow things, outside of a room, or below the floor")
      .one_of({"inside", "outside", "floor"})
      .alone("inside")
      .excludes("--cameras")
      .excludes("--data")
      .excludes("--depths")
      .excludes("--watertight")
      .excludes("--truncation")
      .excludes("--mesh-views");
  option("--components", job.components,
         "keep the N largest pieces [those with 50 triangles and 0.01 % of all]")
      .takes("N")
      .positive();
  option("--decimate", job.triangles,
         "keep N triangles, or more where a noisy surface is full of tunnels [all]")
      .takes("N")
      .positive();
  option("--mesh-views", job.views, "take N views, evenly chosen [all]")
      .takes("N")
      .positive()
      .rare();
  time_option(list, job.time, "moment of Gaussians in space and time, 0 to 1").group("Mesh");
  option("--force", job.force, "if the file exists, move it to FILE.bak-N first");
  render_options(list);
  general_options(list);
}

Outcome run(const MeshJob& given, JobEvents& events) {
  WallClock clock(WallClock::Clock::now());
  MeshJob job = given;
  const bool collides = !job.collision.empty();
  if (job.output.empty())
    job.output = new_place(beside(job.model, collides ? "-collision" : "-mesh"), {".glb"}).string();
  const MeshFormat& format = mesh_format_of(job.output);
  check_place(job.output, job.force);
  MadeMesh made = make(job, clock, events);
  TriangleMesh& mesh = made.mesh;
  const std::size_t pieces = keep_large_pieces(mesh, job.components);
  if (collides && !job.triangles) job.triangles = kCollisionTriangles;
  if (job.triangles) decimate_mesh(mesh, job.triangles);
  compute_normals(mesh);
  clock.end("cleaning");
  const OutputLock lock = OutputLock::of_file(job.output);
  keep_older_aside(job.output);
  AtomicFile file(job.output);
  format.write(file, mesh, made.world_offset);
  file.commit();
  clock.end("file");
  Json seconds;
  for (const auto& [part, time] : clock.parts()) seconds[part] = time;
  return {
      fmt::format("{}: {} triangles in {} {}, with voxels of {:.3g}, from {}\n", job.output,
                  with_commas(mesh.triangles.size()), pieces, pieces == 1 ? "piece" : "pieces",
                  made.voxel, made.views ? fmt::format("{} views", made.views) : "the model alone"),
      {{"output", job.output},
       {"model", made.model},
       {"vertices", mesh.vertices.size()},
       {"triangles", mesh.triangles.size()},
       {"pieces", pieces},
       {"voxel", made.voxel},
       {"views", made.views},
       {"seconds", seconds}},
      {{"look at it", "xdg-open " + shell_word(job.output)}}};
}

Verb mesh_verb() {
  return verb_of<MeshJob>(
      "mesh", VerbGroup::change, "Write the surface of a trained model as a mesh of triangles",
      {"mesh out/scene -o scene.glb", "mesh model.ply -o mesh.ply --cameras cameras.json",
       "mesh out/scene -o solid.glb --collision"});
}

}  // namespace gs
