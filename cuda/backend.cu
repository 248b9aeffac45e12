// SPDX-License-Identifier: Apache-2.0
// The CUDA backend. Its step is a fused sequence of launches. The host neither waits nor reads
// anything back (pending_steps.h).
#include "cuda/backend.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_map>
#include <utility>

#include "cuda/device/clock.cuh"
#include "cuda/device/no_gpu.h"
#include "cuda/device/warp.cuh"
#include "cuda/render/renderer.cuh"
#include "cuda/train/depth.cuh"
#include "cuda/train/pending_steps.h"
#include "cuda/train/photometric_stage.cuh"
#include "gs_core/math/density.h"
#include "gs_core/training_memory.h"
#include "gs_train/named_row.h"

namespace gs::cuda {
namespace {

// The forecast of memory counts these.
static_assert(sizeof(SplatGradientSum) == kGradientSumBytes);
static_assert(sizeof(FineSums) + sizeof(CoarseSums) == kFixedSumBytes);
static_assert(sizeof(FixedFragmentSums) == kFixedFragmentSumBytes);
static_assert(sizeof(Vec4f) * kTileWidth * kTileHeight ==
              kCheckpointBytesOfInstance * kSegmentLength);
static_assert(kFirstInstances == kLeastCapacity);

constexpr int kThreads = 256;

struct LossRow {
  const char* name;  // a word of loss.kind
  std::unique_ptr<Loss> (*make)(Context&, Memory&, PhotoStore&);
};
constexpr LossRow kLosses[] = {{"l1_ssim", make_loss}};

__global__ void gather_kernel(Span<const std::uint32_t> tile_counts, const Vec2f* dL_dmean2d,
                              float* visits, float* gradient_norm, int width, int height) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= tile_counts.size || !tile_counts[i]) return;
  visits[i] += 1.0f;
  gradient_norm[i] += screen_gradient_norm(dL_dmean2d[i], width, height);
}

__global__ void add_kernel(Span<float> to, const float* from, float weight) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i < to.size) to[i] += weight * from[i];
}

// A base class, so that the device is created before all that uses it and destroyed afterwards.
struct Device {
  explicit Device(int index) : context(index), device_memory(context) {}
  Context context;
  DeviceMemory device_memory;
};

// The update of the poses; there is none while they rest.
struct PoseUpdate {
  bool is_due = false;
  AdamStep adam{};
  AdamRule rule = {};
  float pull = 0;
};

struct Step : PendingStep {
  using PendingStep::PendingStep;
  PhotometricUpdate photometric;
  PoseUpdate poses;
};

class CudaBackend final : private Device, private StepLauncher<Step>, public Backend {
 public:
  explicit CudaBackend(int index)
      : Device(index), Backend(device_memory), photos_(context, device_memory),
        renderer_(context, device_memory), loss_(make_loss(context, device_memory, photos_)),
        optimizer_(make_optimizer(context)), sums_(device_memory), photo_buffers_(device_memory),
        photometric_(context, device_memory), poses_(context, device_memory),
        depth_maps_(device_memory), depth_(device_memory),
        rows_(make_row_ops(context, device_memory, pass_.splats, pass_.pixel_rects,
                           [this] { release_step(); })) {}
  ~CudaBackend() override { cudaStreamSynchronize(context.stream()); }

  void make_current() override { check(cudaSetDevice(context.device()), "choosing the GPU"); }
  std::string name() const override {
    return "cuda:" + std::to_string(context.device()) + " (" + context.device_name() + ")";
  }
  Memory& memory() override { return device_memory; }
  Renderer& renderer() override { return renderer_; }
  Optimizer& optimizer() override { return *optimizer_; }
  void use_loss(const std::string& kind) override {
    const LossRow* const row = row_named(kLosses, kind, "loss.kind", " on " + name());
    if (row == loss_row_) return;  // the same loss keeps its last value
    finish_pending();
    loss_ = row->make(context, device_memory, photos_);
    loss_row_ = row;
  }
  Loss& loss() override {
    finish_pending();
    return *loss_;
  }
  void use_photometric(std::shared_ptr<const PhotometricModel> photometric) override {
    finish_pending();
    if (photometric) check_takes_appearance(*loss_, loss_row_->name);
    photometric_.use(photometric.get(), name());
  }
  void check_refines_poses() const override {}
  void check_takes_depth() const override {}
  bool makes_refined_cameras() const override { return true; }
  RowOps& rows() override {
    finish_pending();
    return *rows_;
  }

  void upload_views(const std::vector<View>& views, std::size_t photo_bytes) override {
    finish_pending();
    next_ = nullptr;
    photos_.upload_views(views, photo_bytes);
    depth_maps_.forget();
    steps_.forecast().forget();
  }
  void prefetch_decode(const View& view) override {
    if (!photos_.is_resident(view)) prefetch_photo(view);
  }
  void prefetch_next(const View& view) override { next_ = &view; }

  using Backend::step;
  void step(TrainingModel& model, Span<const TrainingPhoto> batch,
            const LossSettings& loss_settings, const Update& update,
            const DensityStep& density) override {
    take_model(model);
    Step step(model, batch, loss_settings, update, density);
    const PhotometricUpdate photometric = step.photometric =
        photometric_.update_of(model.photometric, update);
    const PoseUpdate poses = step.poses = pose_update(model.poses, update);
    steps_.launch(std::move(step), model.count());
    model.adam_steps += update.rule.steps;
    if (photometric.is_due) model.photometric.adam_steps += photometric.rule.steps;
    if (poses.is_due) model.poses.adam_steps += update.photo_rule.steps;
  }

  void score_photos(TrainingModel& model, Span<const TrainingPhoto> photos,
                    const PixelRule& rule) override {
    finish_pending();
    begin_sums(model);
    model.statistics.sums.fill_zero();
    for (const TrainingPhoto& photo : photos) {
      RenderSettings settings = photo.settings;
      settings.with_depths = false;
      renderer_.forward(model.gaussians.span(), reduced(photo.camera(), photo.reduction), settings,
                        pass_);
      std::optional<PhotoOnDevice> on_device;
      if (photometric_.is_on())
        on_device = PhotoOnDevice{model.photometric.photo(photo.photo_row).data};
      Workspace& workspace = renderer_.workspace();
      find_pixel_values(context, photos_.photo(*photo.view, photo.reduction), *photo.view,
                        on_device ? &*on_device : nullptr, rule, workspace, pass_);
      blend_values(context, settings, workspace, pass_, model.statistics.sums.span());
    }
  }

  void release_caches() override {
    release_pass();
    rows_->release_caches();
    renderer_.release_caches();
    sums_ = BatchSums(device_memory);  // zero between steps; made anew for the next batch
    photo_buffers_.release();          // the same
    photometric_.release_caches();     // the same
    depth_.release();
  }

  void synchronize(TrainingModel&) override {
    finish_pending();
    bring_poses_back();
    context.synchronize();
  }
  void set_profiling(bool on) override { context.set_profiling(on); }
  std::vector<StageTime> stage_times() override { return context.stage_times(); }
  std::optional<double> clock_mhz() override { return cuda::clock_mhz(context, device_memory); }

 protected:
  void add_pixel_scores(const View&, const RenderSettings&, const PixelRule&, RenderPass&,
                        Span<FragmentSums>) override {
    GS_CHECK(false);  // of Backend::score_photos(), which is overridden
  }
  void gather(const DensityStatistics& statistics, const RenderPass& pass,
              Span<const Vec2f> dL_dmean2d) override {
    context.launch("statistics", gather_kernel, blocks_for(dL_dmean2d.size, kThreads), kThreads,
                   Span<const std::uint32_t>{pass.tile_counts.data(), dL_dmean2d.size},
                   dL_dmean2d.data, statistics.visits.data(), statistics.gradient_norm.data(),
                   pass.width, pass.height);
  }
  void add(Span<float> to, Span<const float> from, float weight) override {
    context.launch("sums", add_kernel, blocks_for(to.size, kThreads), kThreads, to, from.data,
                   weight);
  }
  void add(Span<FragmentSums> to, Span<FragmentSums> from) override {
    add_fragment_sums(context, to, from, nullptr);
  }

 private:
  // Steps train this model from now on.
  void take_model(TrainingModel& model) {
    const bool is_another = model_ != &model;
    if (is_another) {
      finish_pending();
      bring_poses_back();
    }
    model_ = &model;
    if (model.poses.empty() || (!is_another && model.poses.is_on_device)) return;
    finish_pending();
    poses_.upload(model.poses);
    has_newer_poses_ = model.poses.is_on_device = true;
  }
  // Where the host has replaced the poses since the last step, those of the device are void.
  void bring_poses_back() {
    if (!std::exchange(has_newer_poses_, false) || !model_->poses.is_on_device) return;
    poses_.download(model_->poses);
    model_->poses.is_on_device = false;
  }

  // Between steps: releases what the next one makes anew, except what row operations borrow.
  void release_step() {
    renderer_.release_caches();
    for (Buffer<std::uint32_t>* const lists :
         {&pass_.tile_counts, &pass_.depth_order, &pass_.tile_splats})
      lists->release();
    pass_.depths.release();
    photo_buffers_.release();
    pass_.scratch<CudaScratch>().room.release();
  }

  // One photo is pulled back and the model updated by one kernel, and so are the photos of most
  // batches together. The gradients of other batches are summed up first.
  void enqueue(const Step& step) override {
    const bool are_together = step.are_together(*model_);
    if (step.density.fragment_statistic() != FragmentStatistic::none) begin_sums(*model_);
    if (step.is_batch() && !are_together) sums_.reserve(*model_);
    photometric_.begin(model_->photometric, step.batch.size());
    std::vector<PhotoRows> photos;
    if (are_together) photos = projected_photos(step);
    for (std::size_t i = 0; i < step.batch.size(); ++i) {
      prefetch_after(step, i);
      differentiate(step, i, are_together);
    }
    if (are_together)
      update_by_photos(context, *model_, {photos.data(), photos.size()}, step.adam, step.rule,
                       step.rounding, step.density, renderer_.workspace().halted.data());
    else if (step.is_batch())
      update(step);
    photometric_.update(model_->photometric, step.photometric, step.photos(),
                        renderer_.workspace().halted.data());
    if (step.poses.is_due)
      poses_.update(step.poses.pull, step.poses.adam, step.poses.rule,
                    renderer_.workspace().halted.data());
    if (step.density.noise.scale > 0)
      add_position_noise(context, model_->gaussians.span(), step.density.noise, step.position_rate,
                         renderer_.workspace().halted.data());
  }

  // Starts to copy the photo that comes after photo i of a step, so that it arrives meanwhile.
  void prefetch_after(const Step& step, std::size_t i) {
    const bool is_last = i + 1 == step.batch.size();
    if (is_last && !next_) return;
    photos_.prefetch_next(is_last ? *std::exchange(next_, nullptr) : *step.batch[i + 1].view);
  }

  // Stage 1 for all photos of a step.
  std::vector<PhotoRows> projected_photos(const Step& step) {
    std::vector<PhotoRows> photos;
    for (std::size_t i = 0; i < step.batch.size(); ++i) {
      const TrainingPhoto& photo = step.batch[i];
      photos.push_back(photo_buffers_.rows(i, reduced(photo.camera(), photo.reduction),
                                           settings_of(step, photo), model_->count(), renderer_,
                                           pass_));
    }
    preprocess_batch(context, model_->gaussians.span(), {photos.data(), photos.size()});
    return photos;
  }

  RenderSettings settings_of(const Step& step, const TrainingPhoto& photo) const {
    RenderSettings settings = photo.settings;
    settings.fragment_statistic = step.density.fragment_statistic();
    settings.with_depths = compares_depth(photo, step.loss_settings);
    return settings;
  }

  // Photo i of a step. Where all are done together, stage 1 comes before it, and stage 7 after it.
  void differentiate(const Step& step, std::size_t i, bool is_together) {
    const TrainingPhoto& photo = step.batch[i];
    const std::uint32_t number = step.number_of(i);
    steps_.reports().clear(number);
    const Camera camera = reduced(photo.camera(), photo.reduction);
    const std::optional<PoseRow> row = row_of(photo);
    const DevicePose* const pose = row ? poses_.refine(*row, i) : nullptr;
    LossSettings loss_settings = step.loss_settings;
    loss_settings.photo_reduction = photo.reduction;
    std::optional<PhotoOnDevice> on_device;
    if (photometric_.is_on()) {
      on_device =
          photometric_.photo(model_->photometric, step.photometric, photo, i, step.batch.size());
      loss_settings.photo_on_device = &*on_device;
    }
    const RenderSettings settings = settings_of(step, photo);
    const GaussiansSpan gaussians = model_->gaussians.span();
    Workspace& workspace = renderer_.workspace();
    const std::uint32_t capacity = steps_.forecast().capacity_for(photo, model_->count());
    StepReport* const report = steps_.reports().of_step(number);
    if (is_together) {
      photo_buffers_.select(i, camera, model_->count(), renderer_, pass_);
      renderer_.finish_projected(settings, pass_, capacity, report, number);
    } else {
      renderer_.reserve_gradients(model_->count(), settings);
      renderer_.forward(gaussians, camera, settings, pass_, capacity, report, number, pose);
    }
    loss_->forward_backward(pass_, *photo.view, loss_settings, dL_dimage_);
    blend_backward(context, settings, dL_dimage_.span(), workspace, pass_);
    if (settings.fragment_statistic != FragmentStatistic::none)
      gather_fragment_sums(context, settings, workspace, pass_,
                           step.is_batch() ? sums_.statistics : model_->statistics);
    add_depth_gradient(photo, loss_settings, settings);
    if (step.poses.is_due)
      gs::cuda::camera_gradient(context, gaussians, camera, settings, workspace, pass_, pose, *row,
                                1.0 / double(step.batch.size()));
    if (is_together) return;
    if (step.is_batch())
      preprocess_backward_and_add(context, gaussians, camera, settings, step.density, workspace,
                                  pass_, 1.0f / float(step.batch.size()), sums_, pose);
    else
      preprocess_backward_and_update(context, *model_, camera, settings, step.adam, step.rule,
                                     step.rounding, step.density, workspace, pass_, pose);
  }

  // Of photos with a depth map: adds to what blend_backward() has left. The loss has asked for the
  // photo, and so for its mask.
  void add_depth_gradient(const TrainingPhoto& photo, const LossSettings& loss_settings,
                          const RenderSettings& settings) {
    const View& view = *photo.view;
    if (!(loss_settings.depth_weight > 0) || !view.has_depth_map) return;
    const DepthMaps::Map& map = depth_maps_.of(view);
    if (map.values.empty()) return;
    depth_.add_gradient(
        context, settings,
        {map.values.data(), photos_.last().mask, view.camera.width, photo.reduction, map.kind},
        loss_settings.depth_weight, renderer_.workspace(), pass_);
  }

  void update(const Step& step) {
    const Regularizers& regularizers = step.density.regularizers;
    if (regularizers.any())
      add_regularizer_gradients(context, model_->gaussians.span(), regularizers,
                                sums_.gradients.span());
    const std::uint32_t* const halted = renderer_.workspace().halted.data();
    update_by_sums(context, *model_, step.adam, step.rule, step.rounding,
                   step.batch.back().settings.sh_degree, regularizers.any(), halted, sums_);
    if (model_->statistics.has_sums)
      add_fragment_sums(context, model_->statistics.sums.span(), sums_.statistics.sums.span(),
                        halted);
  }

  static PoseUpdate pose_update(const PoseState& state, const Update& update) {
    if (state.empty() || !(update.pose_rate > 0)) return {};
    const AdamRule& rule = update.photo_rule;
    return {true, adam_step(state.adam_steps + rule.steps, update.pose_rate), rule,
            update.pose_pull};
  }

  // Of runs that refine poses. A photo has the same row each time its step is launched.
  std::optional<PoseRow> row_of(const TrainingPhoto& photo) const {
    const PoseState& state = model_->poses;
    if (state.empty()) return std::nullopt;
    return poses_.row_of(state, photo.photo_row, photo.view->camera);
  }

  void wait_for_launches() override { context.synchronize(); }
  void clear_failed_step() override {
    renderer_.clear_gradients();
    photo_buffers_.clear_gradients();
    clear_sums();
  }
  void clear_halted_steps() override {
    renderer_.workspace().halted.fill_zero();
    clear_sums();
  }
  void clear_sums() {
    sums_.clear();
    photometric_.clear_gradients();
    poses_.clear_gradient();
  }

  void finish_pending() { steps_.finish(); }

  PhotoStore photos_;
  CudaRenderer renderer_;
  const LossRow* loss_row_ = kLosses;
  std::unique_ptr<Loss> loss_;
  std::unique_ptr<Optimizer> optimizer_;
  BatchSums sums_;
  PhotoBuffers photo_buffers_;
  PhotometricStage photometric_;
  DevicePoses poses_;
  DepthMaps depth_maps_;
  DepthStage depth_;
  bool has_newer_poses_ = false;  // than those of model_
  std::unique_ptr<RowOps> rows_;
  PendingSteps<Step> steps_{*this};
  TrainingModel* model_ = nullptr;
  const View* next_ = nullptr;  // with which the next step begins, until its photo is prefetched
};

}  // namespace

int device_count() {
  int count = 0;
  if (cudaGetDeviceCount(&count) == cudaSuccess) return count;
  cudaGetLastError();
  return 0;
}

std::string why_no_gpu() {
  NoGpu no_gpu;
  int count = 0;
  no_gpu.is_old = cudaGetDeviceCount(&count) == cudaErrorInsufficientDriver;
  cudaRuntimeGetVersion(&no_gpu.runtime_version);
  cudaDriverGetVersion(&no_gpu.driver_version);
  cudaGetLastError();
  return text_of(no_gpu);
}

std::unique_ptr<Backend> make_backend(int index) { return std::make_unique<CudaBackend>(index); }

}  // namespace gs::cuda
