// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/evaluate_run.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "gs_app/session/evaluate_run.h"

#include <algorithm>
#include <utility>

#include "gs_app/pictures/comparison.h"
#include "gs_app/pictures/pictures.h"
#include "gs_app/report/report_views.h"
#include "gs_core/forecast/training_memory.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/depth_error.h"
#include "gs_eval/normal_angle.h"
#include "gs_train/poses/poses.h"

namespace gs {
namespace {

constexpr std::size_t kComparedViews = 4;  // rows of comparison.png

// At the poses that the run has refined, if it has.
std::vector<View> sample_of_training_views(Trainer& trainer, std::size_t wanted) {
  const std::vector<View>& views = trainer.scene().train_views;
  const std::vector<Camera> cameras = refined_cameras(trainer.model().poses, views);
  std::vector<View> sample;
  for (const std::size_t index : evenly_chosen(views.size(), wanted)) {
    sample.push_back(views[index]);
    sample.back().camera = cameras[index];
  }
  return sample;
}

// Writes the pictures of one split, each render and its photo, and keeps those that others show.
class PictureKeeper {
 public:
  PictureKeeper(std::filesystem::path folder, const Vec3f& background, std::size_t views)
      : folder_(std::move(folder)), background_(background), in_report_(shown_in_report(views)),
        compared_(evenly_chosen(views, kComparedViews)) {}

  void keep(std::size_t index, const View& view, Image8 render) {
    waiting_[index] = {shown_photo(view, background_), std::move(render)};
    if (waiting_.size() >= std::size_t(thread_count())) write_files();
  }
  /// Writes what was not written so far, each file by a thread.
  void write_files() {
    std::vector<std::pair<std::filesystem::path, const Image8*>> files;
    for (const auto& [index, view] : waiting_) {
      files.emplace_back(folder_ / "renders" / picture_file(index), &view.render);
      files.emplace_back(folder_ / "gt" / picture_file(index), &view.photo);
    }
    parallel_for(files.size(), 1,
                 [&](std::size_t i) { write_png(files[i].first, *files[i].second); });
    for (auto& [index, view] : std::exchange(waiting_, {}))
      if (is_one_of(in_report_, index) || is_one_of(compared_, index))
        shown_[index] = std::move(view);
  }
  /// Writes the remaining files and a comparison of some views.
  void finish(const std::filesystem::path& comparison) {
    write_files();
    std::vector<Comparison> views;
    for (const std::size_t index : compared_)
      if (shown_.contains(index)) views.push_back(shown_.at(index));
    if (!views.empty()) write_png(comparison, comparison_picture(views));
  }
  ShownViews take_shown() { return std::move(shown_); }

 private:
  static bool is_one_of(const std::vector<std::size_t>& ascending, std::size_t index) {
    return std::binary_search(ascending.begin(), ascending.end(), index);
  }

  std::filesystem::path folder_;
  Vec3f background_;
  std::vector<std::size_t> in_report_, compared_;  // ascending
  ShownViews waiting_, shown_;
};

// Draws views without measuring them.
void draw_views(Trainer& trainer, const std::vector<View>& views,
                const std::function<void(std::size_t, const View&, Image8)>& on_view) {
  Renderer& renderer = trainer.backend().renderer();
  const PackedScene model(trainer.model().gaussians.span());
  const RenderSettings settings = trainer.evaluation_settings();
  RenderPass pass(renderer.memory());
  for_each_with_photo(views, views.size(), [&](std::size_t i, const View& view) {
    renderer.draw(model, view.camera, settings, pass);
    on_view(i, view, renderer.picture_of(pass));
  });
}

}  // namespace

ShownViews evaluate_run(Trainer& trainer, const RunFolder& folder, Lpips* lpips, Results& results,
                        const std::function<void(std::size_t, std::size_t)>& progress) {
  const std::vector<View>& test = trainer.scene().test_views;
  const std::vector<View> some = sample_of_training_views(trainer, kTrainViewsShown);
  const bool has_test = !test.empty();
  const bool is_measured = has_test || lpips || trainer.config().eval.color_corrected;
  PictureKeeper pictures(folder.pictures(has_test ? "test" : "train", trainer.step()),
                         trainer.evaluation_settings().background,
                         has_test ? test.size() : some.size());
  const std::size_t total = test.size() + some.size();
  std::size_t done = 0;
  progress(done, total);
  const auto evaluate_views = [&](const std::vector<View>& views, bool is_shown) {
    Evaluation evaluation = evaluate(
        trainer.backend().renderer(), trainer.model().gaussians.span(), views,
        trainer.evaluation_settings(),
        [&](std::size_t index, const View& view, const ImageF& image) {
          if (is_shown) pictures.keep(index, view, to_image8(image));
          progress(++done, total);
        },
        evaluation_options(trainer, is_shown ? MetricSet{true, lpips} : MetricSet::quick));
    measure_depth(trainer.backend().renderer(), trainer.model().gaussians, views,
                  trainer.evaluation_settings(), evaluation);
    if (trainer.config().surface.is_on())
      measure_normals(trainer.backend().renderer(), trainer.model().gaussians, views,
                      trainer.evaluation_settings(), evaluation);
    return evaluation;
  };
  if (is_measured) {
    results.test = evaluate_views(test, true);
    results.train = evaluate_views(some, !has_test);
  } else {
    draw_views(trainer, some, [&](std::size_t index, const View& view, Image8 render) {
      pictures.keep(index, view, std::move(render));
      progress(++done, total);
    });
  }
  if (done < total) progress(total, total);  // views that are masked everywhere are left out
  pictures.finish(folder.comparison());
  return pictures.take_shown();
}

double forecast_gpu_bytes(Trainer& trainer) {
  const std::size_t count = trainer.gaussian_count();
  TrainingSize size =
      training_size(trainer.config(), picture_sizes(trainer.scene().train_views), double(count));
  const auto cap = std::size_t(std::max<std::int64_t>(trainer.config().density.max_gaussians, 0));
  if (size.growth == RowGrowth::reserved && trainer.model().gaussians.mean.capacity() >= cap)
    size.gaussians = double(std::max(count, cap));
  else
    size.growth = RowGrowth::by_need;
  return training_bytes(size);
}

Results results_of(Trainer& trainer) {
  const Scene& scene = trainer.scene();
  Results results;
  results.iterations = trainer.step();
  results.num_gaussians = trainer.gaussian_count();
  results.removed_floaters = trainer.removed_floaters();
  results.train_seconds = trainer.train_seconds();
  results.device = trainer.backend().name();
  results.seed = trainer.config().train.seed;
  results.world_offset = scene.world_offset;
  results.refinement = scene.refinement;
  results.exposure = scene.exposure;
  results.looks = looks_of(trainer);
  if (const PoseState& poses = trainer.model().poses; !poses.empty())
    results.poses = pose_change(poses, scene.train_views);
  results.peak_gpu_bytes = peak_gpu_bytes(trainer.backend());
  if (results.peak_gpu_bytes) results.forecast_gpu_bytes = forecast_gpu_bytes(trainer);
  return results;
}

}  // namespace gs
