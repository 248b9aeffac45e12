// SPDX-License-Identifier: Apache-2.0
// gemsplat mesh: the surface of a trained model of any trainer, as triangles.
#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "gs_app/export/cameras.h"
#include "gs_app/export/export_model.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/text.h"
#include "gs_app/run/wall_clock.h"
#include "gs_core/evenly_chosen.h"
#include "gs_core/system/bytes.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_model/mesh/clean_mesh.h"
#include "gs_model/mesh/decimate_mesh.h"
#include "gs_model/mesh/mesh_file.h"
#include "gs_render/fusion/fusion.h"
#include "gs_render/fusion/marching_cubes.h"
#include "gs_render/fusion/solid_volume.h"

namespace gs {
namespace {

constexpr double kVoxelPixels = 1.5;  // of the default voxel
// Of decimation, times those of the mesh and what it came from (docs/lab/2026-11-meshes.md).
constexpr double kDecimationBytes = 3;
constexpr std::size_t kCollisionTriangles = 20000;
constexpr Rgb8 kCollisionColor = {160, 160, 160};
constexpr double kLeastVoxelPixels = 0.25;  // smaller voxels lie between the rays of pixels

struct MeshJob : JobSettings {
  std::string model, output, cameras, collision;
  ModelChoice choice;
  std::optional<double> voxel, time;
  FusionRule rule;
  std::size_t components = 0, triangles = 0, views = 0;  // 0: not said
  bool force = false;
};

void visit_options(MeshJob& job, OptionList& list) {
  list("model", job.model, kModelHelp).takes("MODEL|RUN").required();
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
  option("--collision", job.collision,
         "a closed solid of 20,000 triangles from the model alone, without cameras, for games and "
         "robots; with which air: inside hollow things, outside of a room, or below the floor")
      .one_of({"inside", "outside", "floor"})
      .alone("inside")
      .excludes("--cameras")
      .excludes("--data")
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

std::vector<Camera> cameras_of(const MeshJob& job, const OpenedModel& opened,
                               const Config& config) {
  const int resolution = config.dataset.resolution;
  const Vec3d& offset = opened.model.world_offset;
  std::vector<NamedCamera> named;
  if (job.has("dataset.source"))
    named = cameras_of_scene(config.dataset, "all", offset);
  else if (!job.cameras.empty())
    named = cameras_of_file(job.cameras, resolution, offset);
  else if (opened.run)
    named = cameras_of_run(*opened.run, resolution,
                           std::filesystem::exists(opened.run->split()) ? "train" : "all", offset);
  if (named.empty())
    throw UsageError(fmt::format(
        "there are no cameras that see {}; give --cameras with a cameras.json, a transforms.json "
        "or a COLMAP model, or --data SCENE",
        opened.ply.string()));
  std::vector<Camera> cameras;
  for (const std::size_t i : evenly_chosen(named.size(), job.views ? job.views : named.size()))
    cameras.push_back(named[i].camera);
  return cameras;
}

void check_views(const std::vector<Camera>& cameras) {
  double bytes = 0;
  for (const Camera& camera : cameras) bytes += double(kViewBytes) * camera.width * camera.height;
  const double free = double(host_memory().free_bytes());
  if (bytes > free)
    throw Error(fmt::format("the depth of {} views takes {:.1f} GiB, and {:.1f} GiB are free; give "
                            "--mesh-views {}, or smaller views with -r 2",
                            cameras.size(), bytes / kBytesPerGib, free / kBytesPerGib,
                            std::max(1, int(double(cameras.size()) * free / bytes))),
                ExitCode::out_of_memory);
}

/// A fusion with the depth of all cameras, on the backend's device.
std::unique_ptr<Fusion> fusion_of(const MeshJob& job, Backend& backend,
                                  const std::vector<Camera>& cameras, const OpenedModel& opened,
                                  const Config& config, JobEvents& events) {
  Renderer& renderer = backend.renderer();
  std::unique_ptr<Fusion> fusion = renderer.fusion(job.rule);
  const Gaussians gaussians = copy_to(backend.memory(), opened.model);
  RenderSettings settings = view_settings(opened, config);
  settings.for_backward = true;  // the lists of tiles are needed, too
  RenderPass pass(backend.memory());
  for (const Camera& camera : cameras) {
    renderer.forward(gaussians.span(), camera, settings, pass);
    fusion->add(gaussians.span(), camera, settings, pass, renderer.picture_of(pass));
    events.progress("depth rendered", "view", fusion->views().size(), cameras.size());
  }
  return fusion;
}

/// The edge of a voxel, for which there is memory.
float voxel_of(const MeshJob& job, Fusion& fusion) {
  const double pixel = fusion.median_pixel();
  if (!(pixel > 0))
    throw Error(
        fmt::format("no pixel of {} views shows a surface; the cameras look elsewhere, or "
                    "the model is too faint: look at it with `gemsplat view {}`",
                    fusion.views().size(), shell_word(job.model)));
  const double voxel = job.voxel.value_or(kVoxelPixels * pixel);
  if (voxel < kLeastVoxelPixels * pixel)
    throw UsageError(
        fmt::format("--voxel {:.3g} is finer than the views, whose pixels are {:.3g} "
                    "wide on the surface; give --voxel {:.3g} or more",
                    voxel, pixel, 1.01 * kLeastVoxelPixels * pixel));
  const VolumeForecast forecast = fusion.forecast(float(voxel));
  const auto bytes_at = [&](double size) {
    return forecast.bytes_at(size) * (job.triangles ? kDecimationBytes : 1);
  };
  const double free = double(host_memory().free_bytes());
  if (bytes_at(voxel) <= free) return float(voxel);
  double fitting = voxel;
  while (bytes_at(fitting) > free) fitting *= 1.05;
  throw Error(fmt::format("voxels of {:.3g} take {:.1f} GiB, and {:.1f} GiB are free; give --voxel "
                          "{:.3g} or more, or crop the model with `gemsplat edit`",
                          voxel, bytes_at(voxel) / kBytesPerGib, free / kBytesPerGib, fitting),
              ExitCode::out_of_memory);
}

TriangleMesh mesh_of(Fusion& fusion, float voxel, WallClock& clock, JobEvents& events) {
  const Volume volume = fusion.fuse(fusion.frame(voxel), [&](std::size_t done, std::size_t total) {
    events.progress("blocks fused", "block", done, total);
  });
  clock.end("fusion");
  TriangleMesh mesh = surface_of(volume);
  clock.end("triangles");
  if (mesh.triangles.empty())
    throw Error(
        fmt::format("no two of {} views agree on a surface of voxels of {:.3g}; give a "
                    "smaller --voxel, or views that overlap",
                    fusion.views().size(), voxel));
  return mesh;
}

struct MadeMesh {
  TriangleMesh mesh;
  float voxel;
  std::size_t views;  // 0: of the model alone
};

MadeMesh mesh_by_views(const MeshJob& job, const OpenedModel& opened, const Config& config,
                       WallClock& clock, JobEvents& events) {
  const std::vector<Camera> cameras = cameras_of(job, opened, config);
  check_views(cameras);
  clock.end("model");
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const std::unique_ptr<Fusion> fusion = fusion_of(job, *backend, cameras, opened, config, events);
  clock.end("depth");
  const float voxel = voxel_of(job, *fusion);
  TriangleMesh mesh = mesh_of(*fusion, voxel, clock, events);
  const std::vector<char> is_seen = color_vertices(fusion->views(), voxel, mesh);
  clock.end("colors");
  // What no view sees are the rims of surfaces, as thick as the truncation, and what closes a mesh.
  if (!job.rule.is_watertight)
    std::erase_if(mesh.triangles, [&](const Triangle& t) {
      return !is_seen[t[0]] && !is_seen[t[1]] && !is_seen[t[2]];
    });
  return {std::move(mesh), voxel, cameras.size()};
}

MadeMesh mesh_by_opacity(const MeshJob& job, const OpenedModel& opened, WallClock& clock) {
  const Gaussians& gaussians = opened.model.gaussians;
  const VolumeFrame frame = solid_frame(gaussians, float(job.voxel.value_or(0)));
  double bytes = kSolidVoxelBytes * kBlockVoxels;
  for (const std::uint64_t blocks : frame.blocks) bytes *= double(blocks);
  const double free = double(host_memory().free_bytes());
  if (bytes > free)
    throw Error(fmt::format("voxels of {:.3g} take {:.1f} GiB, and {:.1f} GiB are free; give "
                            "--voxel {:.3g} or more, or crop the model with `gemsplat edit`",
                            frame.voxel, bytes / kBytesPerGib, free / kBytesPerGib,
                            1.1 * frame.voxel * std::cbrt(bytes / free)),
                ExitCode::out_of_memory);
  clock.end("model");
  const SolidFill fill = job.collision == "inside"    ? SolidFill::inside
                         : job.collision == "outside" ? SolidFill::outside
                                                      : SolidFill::floor;
  const Volume volume = solid_volume(gaussians, frame, fill);
  clock.end("voxels");
  TriangleMesh mesh = surface_of(volume);
  if (mesh.triangles.empty())
    throw Error(
        fmt::format("no voxel of {:.3g} is half opaque; give a smaller --voxel", frame.voxel));
  mesh.colors.assign(mesh.vertices.size(), kCollisionColor);
  clock.end("triangles");
  return {std::move(mesh), frame.voxel, 0};
}

Outcome run(const MeshJob& given, JobEvents& events) {
  WallClock clock(WallClock::Clock::now());
  MeshJob job = given;
  const bool collides = !job.collision.empty();
  if (job.output.empty())
    job.output = new_place(beside(job.model, collides ? "-collision" : "-mesh"), {".glb"}).string();
  const MeshFormat& format = mesh_format_of(job.output);
  check_place(job.output, job.force);
  OpenedModel opened = open_model(job.model, job.choice.step);
  if (job.time) take_moment(opened, *job.time);
  if (opened.model.gaussians.has_time)
    throw UsageError(opened.ply.string() + " moves; give the moment of the mesh with --time T");
  // A cameras.json has the size of its pictures already; only -r makes them smaller.
  if (!job.has("dataset.source")) opened.config.dataset.resolution = 1;
  const Config config = resolve_to_work(job, opened.config);
  auto [mesh, voxel, views] = collides ? mesh_by_opacity(job, opened, clock)
                                       : mesh_by_views(job, opened, config, clock, events);
  const std::size_t pieces = keep_large_pieces(mesh, job.components);
  if (collides && !job.triangles) job.triangles = kCollisionTriangles;
  if (job.triangles) decimate_mesh(mesh, job.triangles);
  compute_normals(mesh);
  clock.end("cleaning");
  const OutputLock lock = OutputLock::of_file(job.output);
  keep_older_aside(job.output);
  AtomicFile file(job.output);
  format.write(file, mesh, opened.model.world_offset);
  file.commit();
  clock.end("file");
  Json seconds;
  for (const auto& [part, time] : clock.parts()) seconds[part] = time;
  return {fmt::format("{}: {} triangles in {} {}, with voxels of {:.3g}, from {}\n", job.output,
                      with_commas(mesh.triangles.size()), pieces, pieces == 1 ? "piece" : "pieces",
                      voxel, views ? fmt::format("{} views", views) : "the model alone"),
          {{"output", job.output},
           {"model", opened.ply.string()},
           {"vertices", mesh.vertices.size()},
           {"triangles", mesh.triangles.size()},
           {"pieces", pieces},
           {"voxel", voxel},
           {"views", views},
           {"seconds", seconds}},
          {{"look at it", "xdg-open " + shell_word(job.output)}}};
}

}  // namespace

Verb mesh_verb() {
  return verb_of<MeshJob>(
      "mesh", VerbGroup::change, "Write the surface of a trained model as a mesh of triangles",
      {"mesh out/scene -o scene.glb", "mesh model.ply -o mesh.ply --cameras cameras.json",
       "mesh out/scene -o solid.glb --collision"});
}

}  // namespace gs
