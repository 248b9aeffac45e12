// SPDX-License-Identifier: Apache-2.0
// gemsplat mesh: the surface of a trained model of any trainer, as triangles.
#include <spdlog/fmt/fmt.h>

#include "data_loaders/photos/encode/encode_png.h"
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
#include "gs_model/mesh/unwrap_mesh.h"
#include "gs_render/mesh/bake_texture.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
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

/// Replaces the colors of vertices by a texture.
void add_texture(const MeshJob& job, MadeMesh& made) {
  constexpr float kTexelPixels = 0.75f;  // of the median pixel; smaller texels show nothing more
  unwrap_mesh(made.mesh, {int(job.texture), kTexelPixels * made.pixel});
  bake_texture(made.depth_views, made.voxel, kTextureGutter, made.mesh);
}

/// What is written, the mesh last.
std::vector<fs::path> files_of(const MeshJob& job, const MeshFormat& format) {
  const fs::path mesh = job.output;
  if (!job.texture) return {mesh};
  if (!format.takes_textures)
    throw UsageError(job.output +
                     ": --texture needs a .glb, an .obj or a .usdz; name such a file with -o");
  if (mesh.extension() != ".obj") return {mesh};
  return {fs::path(mesh).replace_extension(".png"), fs::path(mesh).replace_extension(".mtl"), mesh};
}

void write_file(const fs::path& path, const std::function<void(ByteSink&)>& write) {
  AtomicFile file(path);
  write(file);
  file.commit();
}

void write_files(const std::vector<fs::path>& files, const MeshFormat& format,
                 const MadeMesh& made) {
  MeshTextureFile texture{{}, files.back().stem().string()};
  if (!made.mesh.texture.empty()) {
    const std::vector<std::uint8_t> png = encode_png(made.mesh.texture);
    texture.png.assign(png.begin(), png.end());
  }
  std::vector<OutputLock> locks;
  for (const fs::path& file : files) locks.push_back(OutputLock::of_file(file));
  for (const fs::path& file : files) keep_older_aside(file);
  if (files.size() > 1) {
    write_file(files[0], [&](ByteSink& sink) { sink.write(texture.png); });
    write_file(files[1], [&](ByteSink& sink) { sink.write(texture.material()); });
  }
  write_file(files.back(), [&](ByteSink& sink) {
    format.write(sink, made.mesh, made.world_offset, texture, made.named_views);
  });
}

}  // namespace

void visit_options(MeshJob& job, OptionList& list) {
  list("model", job.model, std::string(kModelHelp) + "; with --depths a scene")
      .takes("MODEL|RUN")
      .required();
  list(
      "-o,--output", job.output,
      "mesh to write, whose name ends in .glb, .obj, .ply, .stl, .usda, .usdc or .usdz [beside the "
      "model: MODEL-mesh.glb]")
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
      .positive()
      .rare();
  option("--decimate", job.triangles,
         "keep N triangles, or more where a noisy surface is full of tunnels [all]")
      .takes("N")
      .positive();
  option(
      "--texture", job.texture,
      "a texture in place of the vertices' colors, with N pixels along its sides at most [4096]: "
      ".glb, .obj, .usdz")
      .takes("N")
      .between(64, 16384)
      .alone("4096")
      .excludes("--collision");
  option("--agreed", job.is_agreed,
         "leave out pixels whose surface no other view shows: nearer to the truth, with more holes")
      .excludes("--collision")
      .rare();
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
  const std::vector<fs::path> files = files_of(job, format);
  for (const fs::path& file : files) check_place(file.string(), job.force);
  MadeMesh made = make(job, clock, events);
  TriangleMesh& mesh = made.mesh;
  const std::size_t pieces = keep_large_pieces(mesh, job.components);
  if (collides && !job.triangles) job.triangles = kCollisionTriangles;
  if (job.triangles) decimate_mesh(mesh, job.triangles);
  compute_normals(mesh);
  clock.end("cleaning");
  if (job.texture) {
    add_texture(job, made);
    clock.end("texture");
  }
  write_files(files, format, made);
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
       {"texture", made.mesh.texture.empty()
                       ? Json()
                       : Json::array({made.mesh.texture.width, made.mesh.texture.height})},
       {"voxel", made.voxel},
       {"views", made.views},
       {"views_divided_by", made.views_divided_by},
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
