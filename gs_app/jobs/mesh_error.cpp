// SPDX-License-Identifier: Apache-2.0
// gemsplat mesh-error: how far a mesh, or points, are from a surface that is known, and how much
// pictures of a mesh look like photos.
#include <spdlog/fmt/fmt.h>

#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/model_mesh.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/run_folder.h"
#include "gs_app/run/text.h"
#include "gs_core/geometry/vectors.h"
#include "gs_eval/mesh_error.h"
#include "gs_eval/mesh_pictures.h"
#include "gs_model/mesh/mesh_read.h"
#include "gs_render/render_settings.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
constexpr double kUsualThreshold = 0.005;  // of the diagonal of the truth

struct MeshErrorJob : JobSettings {
  std::string mesh, truth;
  MeshErrorRule rule;
  std::size_t seed = 0;
};

void visit_options(MeshErrorJob& job, OptionList& option) {
  option.json_meaning = "print JSON with all digits";
  option("mesh", job.mesh, "what to measure: triangles or points (.ply, .obj, .glb, .stl)")
      .takes("MESH")
      .required();
  option("truth", job.truth,
         "the known surface, such as a scan, in the same units and axes; not needed with --data")
      .takes("TRUTH");
  dataset_options(option, "-d,--data");
  option.get("--data").meaning =
      "draw the mesh as the held-out photos of this scene, or of this run, show it, and compare";
  option.setting("--background", "render.background", "Rendering").rare();
  option("--threshold", job.rule.thresholds,
         "distances that count as right, in world units [0.5 % of the diagonal of TRUTH]")
      .takes("SIZE")
      .positive();
  option("--samples", job.rule.samples, "points on each of the two [1000000]")
      .takes("N")
      .positive();
  option("--seed", job.seed, "of these points [0]").takes("N").rare();
  general_options(option);
}

MeshOfFile read_surface(const std::string& path) {
  MeshOfFile file = read_mesh(path);
  if (!file.mesh.triangles.empty() && !(area_of(file.mesh) > 0))
    throw Error(path + ": its triangles have no area; name another mesh, or points");
  return file;
}

double diagonal_of(const TriangleMesh& mesh) {
  Vec3f low = mesh.vertices[0], high = low;
  for (const Vec3f& vertex : mesh.vertices)
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], vertex[axis]);
      high[axis] = std::max(high[axis], vertex[axis]);
    }
  return double(length(high - low));
}

/// Measures against a known surface.
void compare_surfaces(const MeshErrorJob& job, MeshOfFile mesh, Outcome& outcome) {
  const MeshOfFile truth = read_surface(job.truth);
  const Vec3f shift(mesh.world_offset - truth.world_offset);
  for (Vec3f& vertex : mesh.mesh.vertices) vertex += shift;
  MeshErrorRule rule = job.rule;
  rule.seed = job.seed;
  if (rule.thresholds.empty()) rule.thresholds = {kUsualThreshold * diagonal_of(truth.mesh)};
  const MeshError error = mesh_error(mesh.mesh, truth.mesh, rule);
  outcome.text = fmt::format("accuracy {:.4g}, completeness {:.4g}, Chamfer distance {:.4g}",
                             error.accuracy, error.completeness, error.chamfer());
  outcome.json.update({{"truth", job.truth},
                       {"accuracy", error.accuracy},
                       {"completeness", error.completeness},
                       {"chamfer", error.chamfer()},
                       {"normal_consistency", nullptr},
                       {"within", Json::array()}});
  if (error.normal_consistency) {
    outcome.text += fmt::format(", normal consistency {:.4f}", *error.normal_consistency);
    outcome.json["normal_consistency"] = *error.normal_consistency;
  }
  outcome.text += '\n';
  for (const MeshError::Within& within : error.within) {
    outcome.text += fmt::format("within {:.4g}: precision {:.4f}, recall {:.4f}, F1 {:.4f}\n",
                                within.threshold, within.precision, within.recall, within.f1());
    outcome.json["within"].push_back({{"threshold", within.threshold},
                                      {"precision", within.precision},
                                      {"recall", within.recall},
                                      {"f1", within.f1()}});
  }
}

/// Measures in the photos that a run, or training on a scene, holds out.
void compare_pictures(const MeshErrorJob& job, MeshOfFile mesh, const std::string& source,
                      Outcome& outcome) {
  if (mesh.mesh.triangles.empty())
    throw UsageError(job.mesh + " holds points, which have no picture; leave --data out");
  decode_texture(mesh);
  const RunFolder run_of_data{source};
  const bool is_run = fs::exists(run_of_data.config());
  Config start;
  if (is_run)
    load_config(start, run_of_data.config());
  else
    start.dataset.eval = true;  // holds the usual photos out
  const std::string scene_of_run = start.dataset.source;
  Config config = resolve(job, std::move(start));
  if (is_run) config.dataset.source = scene_of_run;
  const Scene scene =
      scene_for(is_run ? &run_of_data : nullptr, config.dataset, !is_run, mesh.world_offset);
  const MeshPictures pictures =
      compare_mesh_pictures(mesh.mesh, scene.test_views, render_settings(config).background);
  if (pictures.views == 0)
    throw UsageError(source +
                     " holds no photo out; give a run of `gemsplat train --eval`, or a scene");
  outcome.text += fmt::format(
      "pictures of the mesh in {} held-out photos: {:.3f} dB, SSIM {:.4f}; it covers "
      "{:.1f} % of them\n",
      pictures.views, pictures.psnr, pictures.ssim, 100 * pictures.covered);
  outcome.json["pictures"] = {{"data", source},
                              {"views", pictures.views},
                              {"psnr", pictures.psnr},
                              {"ssim", pictures.ssim},
                              {"covered", pictures.covered}};
}

Outcome run(const MeshErrorJob& job, JobEvents&) {
  const Config config = resolve_to_work(job);
  const bool has_photos = job.has("dataset.source");
  if (job.truth.empty() && !has_photos)
    throw UsageError("nothing to compare " + job.mesh +
                     " with; name a known surface behind it, or give the photos with --data");
  const MeshOfFile mesh = read_surface(job.mesh);
  Outcome outcome;
  outcome.is_answer = true;
  outcome.json["mesh"] = job.mesh;
  if (!job.truth.empty()) compare_surfaces(job, mesh, outcome);
  if (has_photos) compare_pictures(job, mesh, config.dataset.source, outcome);
  outcome.next = {{"look at it", "xdg-open " + shell_word(job.mesh)}};
  return outcome;
}

}  // namespace

Verb mesh_error_verb() {
  return verb_of<MeshErrorJob>(
      "mesh-error", VerbGroup::compare, "Measure a mesh against a known surface or photos",
      {"mesh-error scene-mesh.glb scan.ply", "mesh-error mesh.ply scan.ply --threshold 0.01 0.02",
       "mesh-error scene-mesh.glb --data out/scene"});
}

}  // namespace gs
