// SPDX-License-Identifier: Apache-2.0
// Bundle adjustment: solving what refine_problem.h has collected, and the way back into the scene's
// frame.
#include "data_loaders/refine/refine_cameras.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <set>
#include <tuple>

#include "data_loaders/refine/refine_problem.h"
#include "data_loaders/refine/refine_residuals.h"
#include "data_loaders/refine/rigid_motion.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

using namespace rigid;
using namespace refinement;

constexpr double kOutlier = 1;  // pixels: scale of the loss
constexpr int kMostSteps = 50;

std::vector<Motion> poses_of(const ColmapModel& model) {
  std::vector<Motion> poses;
  for (const ColmapImage& image : model.images) poses.push_back(pose_of(image));
  return poses;
}

class Adjustment {
 public:
  explicit Adjustment(ColmapModel& model)
      : model_(model), original_(poses_of(model)), problem_(model) {}

  CameraRefinement run(const RefinementProgress& progress) {
    const auto start = std::chrono::steady_clock::now();
    CameraRefinement result;
    result.observations = problem_.observations.size();
    std::tie(result.mean_error_before, result.median_error_before) = problem_.errors();
    const ColmapModel untouched = copy_without_observations();
    // The Cauchy loss has no gradient far away, so a convex loss brings everything near first.
    if (result.median_error_before > kOutlier) {
      ceres::HuberLoss convex(kOutlier);
      result.steps += solve(convex, progress).num_successful_steps;
    }
    ceres::CauchyLoss robust(kOutlier);
    const ceres::Solver::Summary summary = solve(robust, progress);
    if (progress) progress(kMostSteps, kMostSteps);
    result.steps += summary.num_successful_steps;
    result.has_converged = summary.termination_type == ceres::CONVERGENCE;
    write_poses();
    if (!summary.IsSolutionUsable() || !is_finite()) {
      restore(untouched);
      log_warning("the cameras could not be refined ({}); going on with those of {}",
                  summary.message, model_.folder.string());
    } else {
      return_to_frame();
    }
    std::tie(result.mean_error_after, result.median_error_after) = problem_.errors();
    result.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    result.images = problem_.image_count();
    result.points = problem_.point_count();
    return result;
  }

 private:
  ceres::Solver::Summary solve(ceres::LossFunction& loss, const RefinementProgress& progress);
  void hold_gauge(ceres::Problem& problem);
  void write_poses() {
    for (std::size_t i = 0; i < model_.images.size(); ++i) {
      const Frame& frame = problem_.frame_with(i);
      if (!frame.is_refined) continue;
      const Motion pose =
          product(problem_.cam_from_frame[i], {unit(frame.pose.rotation), frame.pose.translation});
      model_.images[i].cam_from_world_rotation = pose.rotation;
      model_.images[i].cam_from_world_translation = pose.translation;
    }
  }

  bool is_finite() const {
    for (const ColmapImage& image : model_.images)
      if (!gs::is_finite(image.cam_from_world_translation)) return false;
    for (const ColmapPoint& point : model_.points)
      if (!gs::is_finite(point.position)) return false;
    return true;
  }

  void return_to_frame();

  ColmapModel copy_without_observations() const {
    ColmapModel copy;
    copy.cameras = model_.cameras;
    copy.points = model_.points;
    return copy;
  }
  void restore(const ColmapModel& untouched) {
    model_.cameras = untouched.cameras;
    model_.points = untouched.points;
    for (std::size_t i = 0; i < model_.images.size(); ++i) {
      model_.images[i].cam_from_world_rotation = original_[i].rotation;
      model_.images[i].cam_from_world_translation = original_[i].translation;
    }
  }

  ColmapModel& model_;
  const std::vector<Motion> original_;  // of the images
  BundleProblem problem_;
};

/// Shows how far the solver is.
struct ProgressCallback : ceres::IterationCallback {
  explicit ProgressCallback(const RefinementProgress& progress) : progress(progress) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (progress) progress(std::size_t(summary.iteration), kMostSteps);
    return ceres::SOLVER_CONTINUE;
  }
  const RefinementProgress& progress;
};

ceres::LinearSolverType solver_for(std::size_t frames) {
  constexpr std::size_t kDense = 150, kSparse = 1500;  // six rows of the reduced system each
  return frames <= kDense    ? ceres::DENSE_SCHUR
         : frames <= kSparse ? ceres::SPARSE_SCHUR
                             : ceres::ITERATIVE_SCHUR;
}

/// Holds the seven numbers that photos cannot determine, so that the equations have one solution:
/// the pose of the frame with most observations, and the scale. The scale is held by one component
/// of the farthest frame's translation, the one that changes most with it.
void Adjustment::hold_gauge(ceres::Problem& problem) {
  std::vector<std::size_t> counts(problem_.frames.size(), 0);
  for (const Observation& observation : problem_.observations)
    ++counts[problem_.frame_of[observation.image]];
  const auto most = std::max_element(counts.begin(), counts.end());
  if (most == counts.end() || *most == 0) return;
  Frame& held = problem_.frames[std::size_t(most - counts.begin())];
  problem.SetParameterBlockConstant(&held.pose.rotation.w);
  problem.SetParameterBlockConstant(&held.pose.translation.x);
  if (problem_.has_known_size) return;
  Frame* farthest = nullptr;
  Vec3d arm(0.0);  // from the held frame, in the farthest one's axes
  for (Frame& frame : problem_.frames) {
    if (!frame.is_refined) continue;
    const Vec3d from_held = rotated(frame.pose.rotation, center(frame.pose) - center(held.pose));
    if (length(from_held) > length(arm)) arm = from_held, farthest = &frame;
  }
  if (!farthest) return;
  int axis = 0;
  for (int i = 1; i < 3; ++i)
    if (std::abs(arm[i]) > std::abs(arm[axis])) axis = i;
  problem.SetManifold(&farthest->pose.translation.x, new ceres::SubsetManifold(3, {axis}));
}

ceres::Solver::Summary Adjustment::solve(ceres::LossFunction& loss,
                                         const RefinementProgress& progress) {
  ceres::Problem::Options shared;
  shared.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(shared);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  std::set<std::uint32_t> cameras;
  for (const Observation& observation : problem_.observations) {
    Frame& frame = problem_.frame_with(observation.image);
    ColmapCamera& camera = model_.cameras.at(model_.images[observation.image].camera_id);
    double* point = &model_.points[observation.seen.point].position.x;
    problem.AddResidualBlock(
        cost_of({camera.model, problem_.cam_from_frame[observation.image], observation.seen.pixel}),
        &loss, &frame.pose.rotation.w, &frame.pose.translation.x, camera.params.data(), point);
    ordering->AddElementToGroup(point, 0);
    ordering->AddElementToGroup(&frame.pose.rotation.w, 1);
    ordering->AddElementToGroup(&frame.pose.translation.x, 1);
    ordering->AddElementToGroup(camera.params.data(), 1);
    cameras.insert(camera.id);
  }
  for (Frame& frame : problem_.frames)
    if (problem.HasParameterBlock(&frame.pose.rotation.w))
      problem.SetManifold(&frame.pose.rotation.w, new ceres::QuaternionManifold);
  hold_gauge(problem);
  for (const std::uint32_t id : cameras) {
    ColmapCamera& camera = model_.cameras.at(id);
    if (camera.model == CameraModel::equirectangular)  // its size
      problem.SetParameterBlockConstant(camera.params.data());
    else
      problem.AddResidualBlock(prior_of(camera), nullptr, camera.params.data());
  }
  ProgressCallback callback(progress);
  ceres::Solver::Options options;
  options.linear_solver_type = solver_for(problem_.frames.size());
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  options.linear_solver_ordering = ordering;
  options.max_num_iterations = kMostSteps;
  options.function_tolerance = 1e-6;
  // Always some damping: the depth of points seen without parallax is not determined.
  options.max_trust_region_radius = 1e6;
  options.num_threads =
      problem_.observations.size() <= kObservationsOfOneThread ? 1 : thread_count();
  options.logging_type = ceres::SILENT;
  options.callbacks.push_back(&callback);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary;
}

// --- The way back into the scene's frame

void Adjustment::return_to_frame() {
  std::vector<Motion> before, after;
  for (std::size_t i = 0; i < model_.images.size(); ++i) {
    if (!problem_.frame_with(i).is_refined) continue;
    before.push_back(original_[i]);
    after.push_back(pose_of(model_.images[i]));
  }
  if (before.empty()) return;
  const Similarity back = robust_similarity_of(before, after, problem_.has_known_size);
  for (std::size_t i = 0; i < model_.points.size(); ++i)
    if (problem_.point_is_refined[i]) model_.points[i].position = back(model_.points[i].position);
  for (std::size_t i = 0; i < model_.images.size(); ++i) {
    if (!problem_.frame_with(i).is_refined) continue;
    ColmapImage& image = model_.images[i];
    const Vec3d at = back(center(pose_of(image)));
    image.cam_from_world_rotation =
        unit(product(image.cam_from_world_rotation, conjugate(back.rotation)));
    image.cam_from_world_translation = -rotated(image.cam_from_world_rotation, at);
  }
}

}  // namespace

CameraRefinement refine_cameras(ColmapModel& model, const RefinementProgress& progress) {
  return Adjustment(model).run(progress);
}

}  // namespace gs
