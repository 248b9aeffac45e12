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
#include "cuda/train/photo_rows.cuh"
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
        optimizer_(make_optimizer(context)), photo_buffers_(device_memory), forces_(device_memory),
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
    photo_buffers_.release();  // its gradients are zero between steps
    forces_.release();         // the same
    photometric_.release_caches();
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

  void enqueue(const Step& step) override {
    const std::uint32_t* const halted = renderer_.workspace().halted.data();
    const bool sums_fragments = step.density.fragment_statistic() != FragmentStatistic::none;
    if (sums_fragments) begin_sums(*model_);
    photometric_.begin(model_->photometric, step.batch.size());
    const std::vector<PhotoRows> photos = projected_photos(step);
    for (std::size_t i = 0; i < photos.size(); ++i) {
      prefetch_after(step, i);
      differentiate(step, i, photos[i]);
    }
    if (sums_fragments) gather_all_sums(photos);
    update_by_photos(context, *model_, {photos.data(), photos.size()}, step, halted);
    photometric_.update(model_->photometric, step.photometric, step.photos(), halted);
    if (step.poses.is_due) poses_.update(step.poses.adam, step.poses.rule, halted);
    if (step.density.noise.scale > 0)
      add_position_noise(context, model_->gaussians.span(), step.density.noise, step.position_rate,
                         halted);
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
      const std::optional<PoseRow> row = row_of(photo);
      RenderSettings settings = photo.settings;
      settings.fragment_statistic = step.density.fragment_statistic();
      settings.with_depths = step.loss_settings.depth_weight > 0 && photo.view->has_depth_map;
      photos.push_back(photo_buffers_.rows(i, reduced(photo.camera(), photo.reduction), settings,
                                           row ? poses_.refine(*row, i) : nullptr, model_->count(),
                                           renderer_, pass_));
    }
    preprocess(context, model_->gaussians.span(), {photos.data(), photos.size()});
    return photos;
  }

  // Photo i of a step, from stage 2 to dL/d(splat).
  void differentiate(const Step& step, std::size_t i, const PhotoRows& rows) {
    const TrainingPhoto& photo = step.batch[i];
    const RenderSettings& settings = rows.settings;
    const std::uint32_t number = step.number_of(i);
    steps_.reports().clear(number);
    LossSettings loss_settings = step.loss_settings;
    loss_settings.photo_reduction = photo.reduction;
    std::optional<PhotoOnDevice> on_device;
    if (photometric_.is_on()) {
      on_device =
          photometric_.photo(model_->photometric, step.photometric, photo, i, step.batch.size());
      loss_settings.photo_on_device = &*on_device;
    }
    Workspace& workspace = renderer_.workspace();
    photo_buffers_.select(i, rows, model_->count(), renderer_, pass_);
    renderer_.finish_projected(settings, pass_,
                               steps_.forecast().capacity_for(photo, model_->count()),
                               steps_.reports().of_step(number), number);
    loss_->forward_backward(pass_, *photo.view, loss_settings, dL_dimage_);
    blend_backward(context, settings, dL_dimage_.span(), workspace, pass_);
    if (settings.with_depths) {
      if (sums_among_gradients(settings)) gather_forces(rows, step.batch.size());
      add_depth_gradient(photo, loss_settings, settings);
    }
    if (step.poses.is_due)
      gs::cuda::camera_gradient(context, model_->gaussians.span(), rows, workspace, *row_of(photo),
                                1.0 / double(step.batch.size()));
  }

  // Sums of forces among the gradients, before a depth map adds to these. A later photo of the step
  // may be halted, so those of a batch are kept apart until all are drawn.
  void gather_forces(const PhotoRows& photo, std::size_t photos) {
    const std::size_t count = model_->count();
    if (photos > 1 && forces_.size() != count) {
      forces_.resize_discard(count);
      forces_.fill_zero();
    }
    gather_fragment_sums(context, photo,
                         photos > 1 ? forces_.span() : model_->statistics.sums.span(),
                         renderer_.workspace().halted.data());
    has_forces_ |= photos > 1;
  }
  // All other sums over fragments of a step.
  void gather_all_sums(const std::vector<PhotoRows>& photos) {
    const std::uint32_t* const halted = renderer_.workspace().halted.data();
    const Span<FragmentSums> sums = model_->statistics.sums.span();
    for (const PhotoRows& photo : photos)
      if (!sums_among_gradients(photo.settings)) gather_fragment_sums(context, photo, sums, halted);
    if (std::exchange(has_forces_, false)) add_fragment_sums(context, sums, forces_.span(), halted);
  }

  // Adds the gradient of a depth map to what blend_backward() has left. The loss has asked for the
  // photo, and so for its mask.
  void add_depth_gradient(const TrainingPhoto& photo, const LossSettings& loss_settings,
                          const RenderSettings& settings) {
    const View& view = *photo.view;
    const DepthMaps::Map& map = depth_maps_.of(view);
    if (map.values.empty()) return;
    depth_.add_gradient(
        context, settings,
        {map.values.data(), photos_.last().mask, view.camera.width, photo.reduction, map.kind},
        loss_settings.depth_weight, renderer_.workspace(), pass_);
  }

  static PoseUpdate pose_update(const PoseState& state, const Update& update) {
    if (state.empty() || !(update.pose_rate > 0)) return {};
    const AdamRule& rule = update.photo_rule;
    return {true, adam_step(state.adam_steps + rule.steps, update.pose_rate), rule};
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
    forces_.fill_zero();
    has_forces_ = false;
    photometric_.clear_gradients();
    poses_.clear_gradient();
  }

  void finish_pending() { steps_.finish(); }

  PhotoStore photos_;
  CudaRenderer renderer_;
  const LossRow* loss_row_ = kLosses;
  std::unique_ptr<Loss> loss_;
  std::unique_ptr<Optimizer> optimizer_;
  PhotoBuffers photo_buffers_;
  Buffer<FragmentSums> forces_;  // of a batch with depth maps; zero between steps
  bool has_forces_ = false;      // of the step that is being launched
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
