// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <memory>

#include "data_loaders/scene/load_scene.h"
#include "gs_app/export/cameras.h"
#include "gs_app/export/export_model.h"
#include "gs_app/jobs/mesh/mesh_job.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/text.h"
#include "gs_core/evenly_chosen.h"
#include "gs_core/system/bytes.h"
#include "gs_core/system/log.h"
#include "gs_render/fusion/fusion.h"
#include "gs_render/fusion/marching_cubes.h"
#include "gs_render/fusion/solid_volume.h"

namespace gs {
namespace {

constexpr double kVoxelPixels = 1.5;  // of the default voxel
// Of decimation, times those of the mesh and what it came from (docs/lab/2026-11-meshes.md).
constexpr double kDecimationBytes = 3;
constexpr Rgb8 kCollisionColor = {160, 160, 160};
constexpr double kLeastVoxelPixels = 0.25;  // smaller voxels lie between the rays of pixels
constexpr int kSmallViews = 8;              // the most by which views are divided for coarse voxels
constexpr std::size_t kTriedViews = 8;      // that tell how wide pixels are on the surface

std::vector<NamedView> views_of(const MeshJob& job, const OpenedModel& opened,
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
  std::vector<NamedView> views;
  for (const std::size_t i : evenly_chosen(named.size(), job.views ? job.views : named.size()))
    views.push_back({named[i].name, without_lens(named[i].camera)});  // rays of depth are pinholes'
  return views;
}

void check_memory(const std::vector<NamedView>& views) {
  double bytes = 0;
  for (const NamedView& view : views)
    bytes += double(kViewBytes) * view.camera.width * view.camera.height;
  const double free = double(host_memory().free_bytes());
  if (bytes > free)
    throw Error(fmt::format("the depth of {} views takes {:.1f} GiB, and {:.1f} GiB are free; give "
                            "--mesh-views {}, or smaller views with -r 2",
                            views.size(), bytes / kBytesPerGib, free / kBytesPerGib,
                            std::max(1, int(double(views.size()) * free / bytes))),
                ExitCode::out_of_memory);
}

/// A model on the backend's device, and how its depth is drawn.
struct DrawnModel {
  Gaussians gaussians;
  RenderSettings settings;
};
DrawnModel drawn_model(Backend& backend, const OpenedModel& opened, const Config& config) {
  DrawnModel drawn{copy_to(backend.memory(), opened.model), view_settings(opened, config)};
  drawn.settings.for_backward = true;     // the lists of tiles are needed, too
  drawn.settings.order = RenderOrder::z;  // in which surfaces are found
  return drawn;
}

/// A fusion with the depth of all cameras, on the backend's device.
std::unique_ptr<Fusion> fusion_of(const MeshJob& job, Backend& backend,
                                  const std::vector<NamedView>& views, const DrawnModel& model,
                                  JobEvents& events) {
  Renderer& renderer = backend.renderer();
  std::unique_ptr<Fusion> fusion = renderer.fusion(job.rule);
  RenderPass pass(backend.memory());
  for (const auto& [name, camera] : views) {
    renderer.forward(model.gaussians.span(), camera, model.settings, pass);
    fusion->add(model.gaussians.span(), camera, model.settings, pass, renderer.picture_of(pass));
    events.progress("depth rendered", "view", fusion->views().size(), views.size());
  }
  return fusion;
}

std::vector<NamedView> divided(std::vector<NamedView> views, int by) {
  for (NamedView& view : views) view.camera = at_resolution(view.camera, by);
  return views;
}

/// By what views are divided for the voxel that was asked for: 1, 2, 4 or 8. Coarse voxels show no
/// more of large pictures than of small ones, whose pixels are means and have less noise
/// (docs/lab/2026-11-meshes.md). A texture shows all.
int division_for_voxel(const MeshJob& job, Backend& backend, const std::vector<NamedView>& views,
                       const DrawnModel& model) {
  if (!job.voxel || job.texture || job.has("dataset.resolution")) return 1;
  std::vector<NamedView> tried;
  for (const std::size_t i : evenly_chosen(views.size(), kTriedViews)) tried.push_back(views[i]);
  JobEvents silent;
  const double pixel =
      fusion_of(job, backend, divided(tried, kSmallViews), model, silent)->median_pixel() /
      kSmallViews;
  int by = 1;
  while (pixel > 0 && by < kSmallViews && 2 * by * kVoxelPixels * pixel <= *job.voxel) by *= 2;
  return by;
}

/// The edge of a voxel, for which there is memory.
float voxel_of(const MeshJob& job, Fusion& fusion) {
  const double pixel = fusion.median_pixel();
  if (!(pixel > 0))
    throw Error(
        fmt::format("no pixel of {} views shows a surface{}; {}", fusion.views().size(),
                    job.is_agreed ? " that another one shows, too" : "",
                    job.depths.empty()
                        ? "the cameras look elsewhere, or the model is too faint: look at it with "
                          "`gemsplat view " +
                              shell_word(job.model) + "`"
                        : "the depth maps in " + job.depths + " know nothing"));
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

TriangleMesh triangles_of(Fusion& fusion, float voxel, WallClock& clock, JobEvents& events) {
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

/// Fuses what was added.
MadeMesh mesh_of(const MeshJob& job, Fusion& fusion, WallClock& clock, JobEvents& events) {
  if (job.is_agreed) fusion.drop_doubtful();
  clock.end("depth");
  const float voxel = voxel_of(job, fusion);
  TriangleMesh mesh = triangles_of(fusion, voxel, clock, events);
  const std::vector<char> is_seen = color_vertices(fusion.views(), voxel, mesh);
  clock.end("colors");
  // What no view sees are the rims of surfaces, as thick as the truncation, and what closes a mesh.
  if (!job.rule.is_watertight)
    std::erase_if(mesh.triangles, [&](const Triangle& t) {
      return !is_seen[t[0]] && !is_seen[t[1]] && !is_seen[t[2]];
    });
  MadeMesh made{std::move(mesh), voxel, fusion.median_pixel(), fusion.views().size(), {}};
  if (job.texture) made.depth_views = fusion.take_views();
  return made;
}

}  // namespace

MadeMesh mesh_by_views(const MeshJob& job, const OpenedModel& opened, const Config& config,
                       WallClock& clock, JobEvents& events) {
  std::vector<NamedView> views = views_of(job, opened, config);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  auto model = std::make_unique<const DrawnModel>(drawn_model(*backend, opened, config));
  const int by = division_for_voxel(job, *backend, views, *model);
  if (by > 1)
    log_info("views are drawn at 1/{} of their size, since voxels of {:.3g} show no more", by,
             *job.voxel);
  const std::vector<NamedView> drawn = divided(views, by);
  check_memory(drawn);
  clock.end("model");
  const std::unique_ptr<Fusion> fusion = fusion_of(job, *backend, drawn, *model, events);
  model.reset();  // fusion has what it needs
  MadeMesh made = mesh_of(job, *fusion, clock, events);
  made.named_views = std::move(views);
  made.views_divided_by = by;
  return made;
}

MadeMesh mesh_by_depths(const MeshJob& job, const Config& config, WallClock& clock,
                        JobEvents& events) {
  DatasetConfig dataset = config.dataset;
  dataset.source = job.model;
  dataset.depth = job.depths;
  dataset.depth_kind = DepthKind::metric;  // surfaces are in the units of the cameras
  dataset.eval = dataset.exposure = false;
  const Scene scene = load_scene(dataset, {}, PhotoLoading::when_asked);
  std::vector<const View*> views;
  std::vector<NamedView> named;
  for (const View& view : scene.train_views)
    if (view.has_depth_map) views.push_back(&view), named.push_back({view.name, view.camera});
  const std::vector<std::size_t> chosen =
      evenly_chosen(views.size(), job.views ? job.views : views.size());
  check_memory(named);
  clock.end("model");
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const std::unique_ptr<Fusion> fusion = backend->renderer().fusion(job.rule);
  for (const std::size_t i : chosen) {
    const std::shared_ptr<const View> view = with_photo(*views[i]);
    ImageF inverse_depth = view->depth;
    for (std::size_t p = 0; p < inverse_depth.pixels.size(); ++p) {
      float& z = inverse_depth.pixels[p];
      const bool is_known = z > 0 && (view->mask.empty() || view->mask.pixels[p] > 0);
      z = is_known ? 1 / z : kUnknownDepth;
    }
    fusion->add(depth_view(view->camera, std::move(inverse_depth), view->photo));
    release_photo(*views[i]);
    events.progress("depth read", "view", fusion->views().size(), chosen.size());
  }
  MadeMesh made = mesh_of(job, *fusion, clock, events);
  made.model = job.model;
  made.world_offset = scene.world_offset;
  for (const std::size_t i : chosen) made.named_views.push_back(named[i]);
  return made;
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
  return {std::move(mesh), frame.voxel, 0, 0, {}};
}

}  // namespace gs
