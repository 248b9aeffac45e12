// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/evaluate_run.h"
#include "gs_app/session/evaluate_run.h"

#include <algorithm>

#include "data_loaders/photos/photos.h"
#include "gs_app/pictures/comparison.h"
#include "gs_app/pictures/pictures.h"
#include "gs_core/forecast/training_memory.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/depth_error.h"
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

// Keeps the pictures of one split: each render and its photo as files, and those of some views for
// comparison.png.
class PictureKeeper {
 public:
  PictureKeeper(std::filesystem::path folder, const Vec3f& background,
                std::vector<std::size_t> compared)
      : folder_(std::move(folder)), background_(background), compared_(std::move(compared)) {}

  void keep(std::size_t index, const View& view, const ImageF& image) {
    Image8 render = to_image8(image), photo = shown_photo(view, background_);
    if (std::binary_search(compared_.begin(), compared_.end(), index))
      comparisons_.push_back({photo, render});
    const std::string name = picture_file(index);
    files_.push_back({folder_ / "renders" / name, std::move(render)});
    files_.push_back({folder_ / "gt" / name, std::move(photo)});
    if (files_.size() >= 2 * std::size_t(thread_count())) write_files();
  }
  /// Writes what is still in memory. One thread would take longer to compress the pictures than all
  /// of them to measure the views.
  void write_files() {
    parallel_for(files_.size(), 1,
                 [&](std::size_t i) { write_png(files_[i].path, files_[i].picture); });
    files_.clear();
  }
  const std::vector<Comparison>& comparisons() const { return comparisons_; }

 private:
  std::filesystem::path folder_;
  Vec3f background_;
  std::vector<std::size_t> compared_;  // ascending
  std::vector<Comparison> comparisons_;
  struct File {
    std::filesystem::path path;
    Image8 picture;
  };
  std::vector<File> files_;
};

}  // namespace

void evaluate_run(Trainer& trainer, const RunFolder& folder, Lpips* lpips, Results& results,
                  const std::function<void(std::size_t, std::size_t)>& progress) {
  const Scene& scene = trainer.scene();
  const RenderSettings settings = trainer.evaluation_settings();
  const std::vector<View> some = sample_of_training_views(trainer, kTrainViewsShown);
  const bool has_test = !scene.test_views.empty();
  const std::size_t shown =
      has_test ? scene.test_views.size() : std::min(some.size(), kComparedViews);
  PictureKeeper pictures(folder.pictures(has_test ? "test" : "train", trainer.step()),
                         settings.background, evenly_chosen(shown, kComparedViews));
  const std::size_t total = scene.test_views.size() + some.size();
  std::size_t done = 0;
  const auto evaluate_views = [&](const std::vector<View>& views, bool is_shown) {
    return evaluate(
        trainer.backend().renderer(), trainer.model().gaussians.span(), views, settings,
        [&](std::size_t index, const View& view, const ImageF& image) {
          if (is_shown) pictures.keep(index, view, image);
          progress(++done, total);
        },
        evaluation_options(trainer, is_shown ? MetricSet{true, lpips} : MetricSet::quick));
  };
  results.test = evaluate_views(scene.test_views, true);
  results.train = evaluate_views(some, !has_test);
  const auto measure_depths = [&](const std::vector<View>& views, Evaluation& evaluation) {
    measure_depth(trainer.backend().renderer(), trainer.model().gaussians, views, settings,
                  evaluation);
  };
  measure_depths(scene.test_views, results.test);
  measure_depths(some, results.train);
  pictures.write_files();
  if (done < total) progress(total, total);  // views that are masked everywhere are left out
  if (!pictures.comparisons().empty())
    write_png(folder.comparison(), comparison_picture(pictures.comparisons()));
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
