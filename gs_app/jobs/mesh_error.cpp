// SPDX-License-Identifier: Apache-2.0
// gemsplat mesh-error: how far a mesh, or points, are from a surface that is known.
#include <spdlog/fmt/fmt.h>

#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/text.h"
#include "gs_core/geometry/vectors.h"
#include "gs_eval/mesh_error.h"
#include "gs_model/mesh/mesh_read.h"

namespace gs {
namespace {

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
  option("truth", job.truth, "the known surface, such as a scan, in the same units and axes")
      .takes("TRUTH")
      .required();
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

Outcome run(const MeshErrorJob& job, JobEvents&) {
  resolve_to_work(job);
  MeshOfFile mesh = read_surface(job.mesh);
  const MeshOfFile truth = read_surface(job.truth);
  const Vec3f shift(mesh.world_offset - truth.world_offset);
  for (Vec3f& vertex : mesh.mesh.vertices) vertex += shift;
  MeshErrorRule rule = job.rule;
  rule.seed = job.seed;
  if (rule.thresholds.empty()) rule.thresholds = {kUsualThreshold * diagonal_of(truth.mesh)};
  const MeshError error = mesh_error(mesh.mesh, truth.mesh, rule);
  Outcome outcome;
  outcome.is_answer = true;
  outcome.text = fmt::format("accuracy {:.4g}, completeness {:.4g}, Chamfer distance {:.4g}",
                             error.accuracy, error.completeness, error.chamfer());
  outcome.json = {{"mesh", job.mesh},           {"truth", job.truth},
                  {"accuracy", error.accuracy}, {"completeness", error.completeness},
                  {"chamfer", error.chamfer()}, {"normal_consistency", nullptr},
                  {"within", Json::array()}};
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
  outcome.next = {{"look at it", "xdg-open " + shell_word(job.mesh)}};
  return outcome;
}

}  // namespace

Verb mesh_error_verb() {
  return verb_of<MeshErrorJob>(
      "mesh-error", VerbGroup::compare, "Measure a mesh or points against a known surface",
      {"mesh-error scene-mesh.glb scan.ply", "mesh-error mesh.ply scan.ply --threshold 0.01 0.02",
       "mesh-error points.ply scan.ply --json"});
}

}  // namespace gs
