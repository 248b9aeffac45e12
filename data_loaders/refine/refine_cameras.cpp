// SPDX-License-Identifier: Apache-2.0
// Bundle adjustment in three parts: what enters the problem, solving it, and the way back into the
// scene's frame.
#include "data_loaders/refine/refine_cameras.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <set>
#include <unordered_map>

#include "data_loaders/lenses/lens.h"
#include "data_loaders/lenses/lens_formulas.h"
#include "data_loaders/refine/refine_residuals.h"
#include "data_loaders/refine/rigid_motion.h"
#include "data_loaders/refine/tracks.h"
#include "gs_core/log.h"
#include "gs_core/math/rotation.h"
#include "gs_core/parallel.h"

namespace gs {
namespace {

using namespace rigid;
using namespace refinement;

constexpr double kOutlier = 1;  // pixels: scale of the loss
constexpr int kMostSteps = 50;
constexpr std::size_t kFewestInFrame = 10;  // observations: six unknowns, and some are wrong

// --- The problem

/// Images that move as one.
struct Frame {
  std::vector<std::size_t> images;  // the first one's pose is the frame's
  Motion pose;                      // frame from world
  bool is_refined = true;
};

/// One photo of one point, as it enters the problem.
struct Observation {
  std::size_t image;
  SeenPoint seen;
};

Motion pose_of(const ColmapImage& image) {
  return {image.cam_from_world_rotation, image.cam_from_world_translation};
}

class Adjustment {
 public:
  explicit Adjustment(ColmapModel& model) : model_(model), original_(model.images) {
    for (const auto& [id, camera] : model.cameras) {
      const auto user =
          std::find_if(model.images.begin(), model.images.end(),
                       [id = id](const ColmapImage& image) { return image.camera_id == id; });
      if (user != model.images.end()) lens_camera(camera, user->name);  // throws for unknown lenses
    }
    make_frames();
    collect(seen_points(model, "--refine-cameras"));
  }

  CameraRefinement run(const RefinementProgress& progress) {
    const auto start = std::chrono::steady_clock::now();
    CameraRefinement result;
    result.observations = observations_.size();
    std::tie(result.mean_error_before, result.median_error_before) = errors();
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
    std::tie(result.mean_error_after, result.median_error_after) = errors();
    result.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    for (const Frame& frame : frames_) result.images += frame.is_refined ? frame.images.size() : 0;
    result.points =
        point_is_refined_.size() -
        std::size_t(std::count(point_is_refined_.begin(), point_is_refined_.end(), false));
    return result;
  }

 private:
  void make_frames() {
    std::unordered_map<std::uint64_t, std::size_t> frame_of_image;  // index in model.frames
    for (std::size_t i = 0; i < model_.frames.size(); ++i)
      for (const std::uint64_t image : model_.frames[i].image_ids) frame_of_image[image] = i;
    std::unordered_map<std::size_t, std::size_t> place;  // in frames_
    for (std::size_t i = 0; i < model_.images.size(); ++i) {
      const auto found = frame_of_image.find(model_.images[i].id);
      const bool is_new =
          found == frame_of_image.end() || place.try_emplace(found->second, frames_.size()).second;
      if (is_new) frames_.push_back({{}, pose_of(model_.images[i]), true});
      const std::size_t frame = is_new ? frames_.size() - 1 : place.at(found->second);
      frames_[frame].images.push_back(i);
      frame_of_.push_back(frame);
      cam_from_frame_.push_back(product(pose_of(model_.images[i]), inverse(frames_[frame].pose)));
    }
    for (const Frame& frame : frames_)
      for (const std::size_t image : frame.images)
        has_known_size_ = has_known_size_ || length(cam_from_frame_[image].translation) > 0;
  }

  /// Keeps points that two or more photos show in front of them, and frames that show enough of
  /// these.
  void collect(const std::vector<std::vector<SeenPoint>>& seen) {
    std::vector<Observation> all;
    for (std::size_t image = 0; image < seen.size(); ++image)
      for (const SeenPoint& point : seen[image])
        if (is_in_front(image, point)) all.push_back({image, point});
    keep_refinable(all);
    std::vector<std::size_t> in_frame(frames_.size(), 0);
    for (const Observation& observation : all) ++in_frame[frame_of_[observation.image]];
    for (std::size_t i = 0; i < frames_.size(); ++i)
      frames_[i].is_refined = in_frame[i] >= kFewestInFrame;
    std::erase_if(all,
                  [&](const Observation& o) { return !frames_[frame_of_[o.image]].is_refined; });
    keep_refinable(all);
    observations_ = std::move(all);
  }

  void keep_refinable(std::vector<Observation>& all) {
    std::vector<int> photos(model_.points.size(), 0);
    for (const Observation& observation : all) ++photos[observation.seen.point];
    point_is_refined_.resize(photos.size());
    for (std::size_t i = 0; i < photos.size(); ++i) point_is_refined_[i] = photos[i] >= 2;
    std::erase_if(all, [&](const Observation& o) { return !point_is_refined_[o.seen.point]; });
  }

  bool is_in_front(std::size_t image, const SeenPoint& seen) const {
    const Vec2d error = error_of({image, seen});
    const Motion pose = pose_of(model_.images[image]);
    const Vec3d at = rotated(pose.rotation, model_.points[seen.point].position) + pose.translation;
    const LensCamera::Lens lens = lens_of(image);
    const bool sees_behind = lens == Lens::fisheye || lens == Lens::fisheye_rad_tan;
    return (sees_behind || at.z > kNearest) && std::isfinite(error.x + error.y);
  }

  Lens lens_of(std::size_t image) const {
    const ColmapCamera& camera = model_.cameras.at(model_.images[image].camera_id);
    FocalPlane<double> plane;
    LensCoefficients<double> lens;
    unpack<double>(camera.model, camera.params.data(), plane, lens);
    return lens.lens;
  }

  /// The reprojection error of an observation with the current pose of its image, in pixels.
  Vec2d error_of(const Observation& observation) const {
    const ColmapImage& image = model_.images[observation.image];
    const ColmapCamera& camera = model_.cameras.at(image.camera_id);
    const Vec3d at =
        rotated(image.cam_from_world_rotation, model_.points[observation.seen.point].position) +
        image.cam_from_world_translation;
    return landed<double>(camera.model, camera.params.data(), at) - observation.seen.pixel;
  }

  /// Mean and median length of the observations' errors, pixels.
  std::pair<double, double> errors() const {
    if (observations_.empty()) return {0, 0};
    std::vector<double> lengths;
    double sum = 0;
    for (const Observation& observation : observations_) {
      const Vec2d error = error_of(observation);
      lengths.push_back(std::sqrt(inner(error, error)));
      sum += lengths.back();
    }
    const auto middle = lengths.begin() + std::ptrdiff_t(lengths.size() / 2);
    std::nth_element(lengths.begin(), middle, lengths.end());
    return {sum / double(lengths.size()), *middle};
  }

  ceres::Solver::Summary solve(ceres::LossFunction& loss, const RefinementProgress& progress);

  void hold_gauge(ceres::Problem& problem);
  void write_poses() {
    for (std::size_t i = 0; i < model_.images.size(); ++i) {
      const Frame& frame = frames_[frame_of_[i]];
      if (!frame.is_refined) continue;
      const Motion pose =
          product(cam_from_frame_[i], {unit(frame.pose.rotation), frame.pose.translation});
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

  /// Poses alone.
  struct Poses : std::vector<Motion> {
    explicit Poses(const std::vector<ColmapImage>& images) {
      for (const ColmapImage& image : images) push_back(pose_of(image));
    }
  };

  ColmapModel& model_;
  const Poses original_;
  std::vector<Frame> frames_;
  std::vector<std::size_t> frame_of_;   // of each image
  std::vector<Motion> cam_from_frame_;  // of each image; never changes
  bool has_known_size_ = false;         // a rig with cameras apart holds the scale
  std::vector<bool> point_is_refined_;
  std::vector<Observation> observations_;
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
  std::vector<std::size_t> counts(frames_.size(), 0);
  for (const Observation& observation : observations_) ++counts[frame_of_[observation.image]];
  const auto most = std::max_element(counts.begin(), counts.end());
  if (most == counts.end() || *most == 0) return;
  Frame& held = frames_[std::size_t(most - counts.begin())];
  problem.SetParameterBlockConstant(&held.pose.rotation.w);
  problem.SetParameterBlockConstant(&held.pose.translation.x);
  if (has_known_size_) return;
  Frame* farthest = nullptr;
  Vec3d arm(0.0);  // from the held frame, in the farthest one's axes
  for (Frame& frame : frames_) {
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
  for (const Observation& observation : observations_) {
    Frame& frame = frames_[frame_of_[observation.image]];
    ColmapCamera& camera = model_.cameras.at(model_.images[observation.image].camera_id);
    double* point = &model_.points[observation.seen.point].position.x;
    problem.AddResidualBlock(
        cost_of({camera.model, cam_from_frame_[observation.image], observation.seen.pixel}), &loss,
        &frame.pose.rotation.w, &frame.pose.translation.x, camera.params.data(), point);
    ordering->AddElementToGroup(point, 0);
    ordering->AddElementToGroup(&frame.pose.rotation.w, 1);
    ordering->AddElementToGroup(&frame.pose.translation.x, 1);
    ordering->AddElementToGroup(camera.params.data(), 1);
    cameras.insert(camera.id);
  }
  for (Frame& frame : frames_)
    if (problem.HasParameterBlock(&frame.pose.rotation.w))
      problem.SetManifold(&frame.pose.rotation.w, new ceres::QuaternionManifold);
  hold_gauge(problem);
  for (const std::uint32_t id : cameras) {
    ColmapCamera& camera = model_.cameras.at(id);
    problem.AddResidualBlock(prior_of(camera), nullptr, camera.params.data());
  }
  ProgressCallback callback(progress);
  ceres::Solver::Options options;
  options.linear_solver_type = solver_for(frames_.size());
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  options.linear_solver_ordering = ordering;
  options.max_num_iterations = kMostSteps;
  options.function_tolerance = 1e-6;
  // Always some damping: the depth of points seen without parallax is not determined.
  options.max_trust_region_radius = 1e6;
  options.num_threads = observations_.size() <= kObservationsOfOneThread ? 1 : thread_count();
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
    if (!frames_[frame_of_[i]].is_refined) continue;
    before.push_back(original_[i]);
    after.push_back(pose_of(model_.images[i]));
  }
  if (before.empty()) return;
  const Similarity back = robust_similarity_of(before, after, has_known_size_);
  for (std::size_t i = 0; i < model_.points.size(); ++i)
    if (point_is_refined_[i]) model_.points[i].position = back(model_.points[i].position);
  for (std::size_t i = 0; i < model_.images.size(); ++i) {
    if (!frames_[frame_of_[i]].is_refined) continue;
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
