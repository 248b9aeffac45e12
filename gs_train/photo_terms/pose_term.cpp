// SPDX-License-Identifier: Apache-2.0
// Poses of training photos that are refined while training (gs_train/poses).
#include "gs_core/math/loss/area_filter.h"
#include "gs_render/stages.h"
#include "gs_train/photo_terms/photo_term.h"
#include "gs_train/poses/poses.h"

namespace gs {
namespace {

class PoseTerm final : public PhotoTerm {
 public:
  void begin(const TrainingModel& model, const Update& update) override {
    sum_.assign(update.pose_rate > 0 ? model.poses.size() : 0, 0.0);
  }

  void prepare(const TrainingModel& model, StepPhoto& photo) override {
    if (model.poses.empty()) return;
    const TrainingPhoto& given = photo.given;
    photo.camera =
        reduced(refined_camera(model.poses, given.view->camera, given.photo_row), given.reduction);
  }

  void add_gradient(const TrainingModel& model, const StepPhoto& photo, const RenderPass& pass,
                    double weight) override {
    if (sum_.empty()) return;
    const CameraGradient<double> dL =
        camera_gradient(model.gaussians.span(), photo.camera, photo.settings, pass);
    add_pose_gradient(model.poses, photo.given.photo_row, photo.given.view->camera, dL, weight,
                      sum_);
  }

  void update(TrainingModel& model, const Update& update) override {
    if (sum_.empty()) return;
    update_table(model.poses, pose_pulls(model.poses), update.pose_rate, update.photo_rule, sum_);
  }

 private:
  std::vector<double> sum_;  // (rows, 6) dL/d(motions); empty while poses rest
};

}  // namespace

std::unique_ptr<PhotoTerm> make_pose_term(const std::shared_ptr<const PhotometricModel>&) {
  return std::make_unique<PoseTerm>();
}

}  // namespace gs
