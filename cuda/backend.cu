// SPDX-License-Identifier: Apache-2.0
// The CUDA backend, of one GPU or of several of one process, which may be one of several. Its step
// is a fused sequence of launches (enqueue()). The host neither waits nor reads anything back
// (pending_steps.h).
//
//   each GPU           projects its rows for all photos, into the buffers of the GPU that draws each
//   the photo's GPU    sorts, blends, compares, blends backward, one of its photos after another
//   each GPU           pulls the gradients of its rows back, and updates its rows
//
// Between two lines GPUs wait for each other. Their kernels read and write each other's memory, so
// that nothing is packed, sent and unpacked. Splats lie in the order of the whole model, and every
// sum is that of one GPU: with RenderSettings::deterministic the model has the same bytes for any
// number of GPUs. What is learned of photos is on the first GPU. A GPU that is alone trains the
// model itself, and nothing is dealt.
//
// Several processes have the whole model each, and draw the photos of a batch in turn. They share the
// gradients of the splats (gpus/processes.cuh), and then update their models alike.
#include "cuda/backend.h"

#include <optional>
#include <string_view>
#include <utility>

#include "cuda/device/clock.cuh"
#include "cuda/device/no_gpu.h"
#include "cuda/gpus/gpu.cuh"
#include "cuda/gpus/processes.cuh"
#include "cuda/photo_terms/photometric.cuh"
#include "cuda/photo_terms/poses.cuh"
#include "cuda/step/pending_steps.h"
#include "gs_core/math/density/density.h"
#include "gs_core/system/fnv1a.h"
#include "gs_core/system/version.h"
#include "gs_train/named_row.h"
#include "gs_train/photometric/gains.h"
#include "gs_train/poses/poses.h"

namespace gs::cuda {
namespace {

constexpr LossRow kLosses[] = {{"l1_ssim", make_loss}};

// A GPU whose photo did not fit halts all.
__global__ void halt_kernel(std::uint32_t* mine, const std::uint32_t* of_photo) {
  if (*of_photo) *mine = 1;
}

// The rows of a dealt model are with the GPUs, and it has no statistics of its own: so the model
// itself says where its rows are, also where another model lies at the same place.
bool is_dealt(const TrainingModel& model) {
  return model.statistics.visits.size() != model.count();
}

template <class T>
std::string_view bytes_of(const T& value) {
  return {reinterpret_cast<const char*>(&value), sizeof value};
}

// The hash of names, cameras and exposures.
std::uint64_t hash_of(const std::vector<View>& views) {
  Fnv1a hash;
  for (const View& view : views) {
    hash.add(view.name);
    hash.add(bytes_of(view.camera));
    hash.add(bytes_of(view.exposure));
  }
  return hash.value();
}
std::uint64_t hash_of(std::string_view text) {
  Fnv1a hash;
  hash.add(text);
  return hash.value();
}

Features features_of(std::size_t devices, const Process& process) {
  return {names_of(kLosses),
          {kNoPhotometricModel, kGainsModel},
          process.count > 1,
          devices == 1 && process.count == 1,
          devices == 1 && process.count == 1,
          false};
}

class CudaBackend final : private Gpus, private StepLauncher, private Device, public Backend {
 public:
  CudaBackend(const std::vector<int>& devices, std::size_t chunk_rows, const Process& process)
      : Gpus(devices), Backend(features_of(devices.size(), process)), chunk_rows_(chunk_rows),
        others_(process.count > 1 ? std::make_unique<Processes>(process, static_cast<Gpus&>(*this))
                                  : nullptr),
        photometric_(first().context, first().memory, process.count > 1),
        poses_(first().context, first().memory),
        rows_(make_row_ops(first().context, first().memory, first().pass.splats,
                           first().pass.pixel_rects, [this] { release_step(); })) {
    for_each([this](Gpu& gpu) { gpu.use(*loss_row_); });
    // Their models are the same to the last bit, and no process tells the others of its own.
    if (others_)
      others_->check_same(hash_of(first().context.device_name() + kVersion),
                          "GPUs or another version of gemsplat");
  }
  ~CudaBackend() override { streams().wait(); }

  void make_current() override { check(cudaSetDevice(first().device()), "choosing the GPU"); }
  std::string name() const override {
    const std::string name =
        "cuda:" + std::to_string(first().device()) + " (" + first().context.device_name() + ")";
    const std::size_t all = processes() * count();
    return all > 1 ? name + " and others (" + std::to_string(all) + " GPUs)" : name;
  }
  Memory& memory() override { return first().memory; }
  Device& device() override { return *this; }
  void* stream() override { return first().context.stream(); }
  Renderer& renderer() override { return first().renderer; }
  void use(const RunChoices& choices) override {
    finish_pending();
    photometric_.use(choices.photometric);
    if (choices.own_loss.compare) {
      for_each([&](Gpu& gpu) {
        gpu.loss = make_function_loss(
            choices.own_loss, gpu.memory,
            [&gpu](const View& view, int reduction) { return gpu.photos.photo(view, reduction); },
            [&gpu] { gpu.context.synchronize(); });
      });
      loss_row_ = nullptr;
      return;
    }
    const LossRow* const row = row_named(kLosses, choices.loss, "loss.kind");
    if (row == loss_row_) return;  // the same loss keeps its last value
    for_each([row](Gpu& gpu) { gpu.use(*row); });
    loss_row_ = row;
  }
  Loss& loss() override {
    finish_pending();
    return *last_drawer_->loss;
  }
  RowOps& rows() override {
    finish_pending();
    if (shards_are_in_use_ && is_dealt(*model_)) gather(*model_);
    return *rows_;
  }

  void upload_views(const std::vector<View>& views, std::size_t photo_bytes) override {
    finish_pending();
    next_ = nullptr;
    for_each([&](Gpu& gpu) {
      gpu.photos.upload_views(views, photo_bytes);
      gpu.depth_maps.forget();
      gpu.normal_maps.forget();
    });
    steps_.forecast().forget();
    if (others_) others_->check_same(hash_of(views), "photos or cameras");
  }
  void prefetch_decode(const View& view) override {
    if (!first().photos.is_resident(view)) prefetch_photo(view);
  }
  void prefetch_next(const View& view) override { next_ = &view; }

  using Backend::step;
  void step(TrainingModel& model, const TrainingStep& asked) override {
    take_model(model);
    if (are_several() && !is_dealt(model)) deal(model);
    const Update& update = asked.update;
    PendingStep step(model, asked);
    step.photometric = photometric_.update_of(model.photometric, update);
    step.poses = poses_.update_of(model.poses, update);
    const bool gains_are_due = step.photometric.is_due, poses_are_due = step.poses.is_due;
    steps_.launch(std::move(step), model.count(), !loss_row_);
    model.adam_steps += update.rule.steps;
    if (gains_are_due) model.photometric.adam_steps += update.photo_rule.steps;
    if (poses_are_due) model.poses.adam_steps += update.photo_rule.steps;
  }

  // On the whole model, by the first GPU.
  void score_photos(TrainingModel& model, Span<const TrainingPhoto> photos,
                    const PixelRule& rule) override {
    finish_pending();
    gather_if_dealt(model);
    begin_sums(model);
    model.statistics.sums.fill_zero();
    Gpu& gpu = first();
    const PoseState poses = copy_to(host_memory(), model.poses);
    for (const TrainingPhoto& photo : photos) {
      const RenderSettings& settings = photo.settings;
      const Camera camera = refined_camera(poses, photo.view->camera, photo.photo_row);
      gpu.renderer.forward(model.gaussians.span(), reduced(camera, photo.reduction), settings,
                           gpu.pass);
      std::optional<PhotoOnDevice> on_device;
      if (photometric_.is_on())
        on_device = PhotoOnDevice{model.photometric.row(photo.photo_row).data};
      Workspace& workspace = gpu.renderer.workspace();
      find_pixel_values(gpu.context, gpu.photos.photo(*photo.view, photo.reduction), *photo.view,
                        on_device ? &*on_device : nullptr, rule, workspace, gpu.pass);
      blend_values(gpu.context, settings, workspace, gpu.pass, model.statistics.sums.span());
    }
  }

  void release_caches() override {
    rows_->release_caches();
    for_each([this](Gpu& gpu) {
      gpu.release_caches();
      if (!shards_are_in_use_) gpu.shard = TrainingModel(gpu.memory);
    });
    poses_.release_caches();
  }

  void synchronize(TrainingModel& model) override {
    finish_pending();
    gather_if_dealt(model);
    first().context.synchronize();
    if (!others_) return;
    streams().synchronize();
    others_->rest();
  }
  void set_profiling(bool on) override { first().context.set_profiling(on); }
  std::vector<StageTime> stage_times() override { return first().context.stage_times(); }
  std::optional<double> clock_mhz() override {
    return cuda::clock_mhz(first().context, first().memory);
  }

 private:
  // Steps train this model from now on.
  void take_model(TrainingModel& model) {
    if (model_ != &model) finish_pending();
    model_ = &model;
  }

  // Gives all GPUs their rows, which steps train from now on.
  void deal(TrainingModel& model) {
    finish_pending();
    deal_out(model, chunk_rows_);
    model.statistics.visits.resize(0);
    shards_are_in_use_ = true;
  }
  void gather(TrainingModel& model) {
    model.statistics.visits.resize(model.count());
    merge(model);
    shards_are_in_use_ = false;
  }
  void gather_if_dealt(TrainingModel& model) {
    if (are_several() && model_ == &model && is_dealt(model)) gather(model);
  }

  // Between steps, before large arrays of the model grow.
  void release_step() {
    for_each([this](Gpu& gpu) {
      gpu.release_step();
      if (!shards_are_in_use_) gpu.shard = TrainingModel(gpu.memory);
    });
  }

  // Photo i of a batch belongs to process i mod processes. Its GPU, and where it comes among the
  // photos of that GPU, are the same in all processes: those that do not draw it keep its arrays.
  std::size_t processes() const { return others_ ? others_->count() : 1; }
  bool draws(std::size_t i) const { return !others_ || others_->draws(i); }
  Gpu& drawer_of(std::size_t i) { return (*this)[gpu_of(i)]; }
  std::size_t gpu_of(std::size_t i) const { return i / processes() % count(); }
  std::size_t turn_of(std::size_t i) const {
    return i / (processes() * count()) * processes() + i % processes();
  }
  // The rows that a GPU trains.
  TrainingModel& rows_of(Gpu& gpu) { return are_several() ? gpu.shard : *model_; }

  // No GPU begins its update before all memory for the step was found.
  void enqueue(const PendingStep& step) override {
    begin(step);
    const std::vector<PhotoRows> photos = photo_rows(step);
    const Span<const PhotoRows> all{photos.data(), photos.size()};
    meet();
    for_each(
        [&](Gpu& gpu) { preprocess(gpu.context, rows_of(gpu).gaussians.span(), all, gpu.place); });
    meet();
    for (std::size_t i = 0; i < photos.size(); ++i)
      if (draws(i))
        draw(step, i, photos[i]);
      else
        steps_.reports().settle(step.number_of(i));
    meet();
    if (others_) share(step, photos);
    for_each([&](Gpu& gpu) { update_rows(step, gpu, all); });
    if (step.poses.is_due) meet();
    update_what_is_learned_of_photos(step);
  }

  // What all photos of a step add to.
  void begin(const PendingStep& step) {
    photometric_.begin(model_->photometric, step.batch.size());
    poses_.begin(model_->poses);
    if (step.poses.is_due) poses_.reserve_sums(step.batch.size(), model_->count());
    if (step.density.fragment_statistic() == FragmentStatistic::none) return;
    begin_sums(*model_);
    if (are_several()) for_each([](Gpu& gpu) { begin_sums(gpu.shard); });
  }

  // Where stage 1 projects the photos of a step to.
  std::vector<PhotoRows> photo_rows(const PendingStep& step) {
    std::vector<PhotoRows> photos;
    for (std::size_t i = 0; i < step.batch.size(); ++i) {
      const TrainingPhoto& photo = step.batch[i];
      const std::optional<PoseRow> row = row_of(photo);
      RenderSettings settings = photo.settings;
      settings.fragment_statistic = step.density.fragment_statistic();
      settings.blends_depth = first().loss->sees_depth() ||
                              (step.loss_settings.depth_weight > 0 && photo.view->has_depth_map);
      settings.blends_surface = step.loss_settings.surface.any();
      const DevicePose* const pose = row ? poses_.refine(*row, i) : nullptr;
      Gpu& gpu = drawer_of(i);
      const OnDevice here(gpu.device());
      photos.push_back(
          gpu.photo_buffers.rows(turn_of(i), reduced(photo.view->camera, photo.reduction), settings,
                                 pose, model_->count(), gpu.renderer, gpu.pass));
      if (i > 0 && i < processes() * count() && draws(i)) gpu.photos.prefetch_next(*photo.view);
    }
    return photos;
  }

  // Photo i of a step, from stage 2 to dL/d(splat).
  void draw(const PendingStep& step, std::size_t i, const PhotoRows& rows) {
    Gpu& gpu = drawer_of(i);
    last_drawer_ = &gpu;
    const OnDevice here(gpu.device());
    prefetch_after(step, i, gpu);
    const TrainingPhoto& photo = step.batch[i];
    RenderSettings settings = rows.settings;
    settings.mask = mask_of_tiles(gpu, photo, settings);
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
    gpu.photo_buffers.select(turn_of(i), rows, model_->count(), gpu.renderer, gpu.pass);
    if (settings.order == RenderOrder::pixel)
      find_ray_depths(gpu.context, model_->gaussians.span(), rows.camera, rows.pose, gpu.pass);
    StepReport* const report = steps_.reports().of_step(number);
    // Other processes do not learn of a step that has to be repeated, and a loss of the program sees
    // what it lacked. A view that was not seen before may have any number.
    if (others_ || (!loss_row_ && !steps_.forecast().has_seen(*photo.view)))
      gpu.renderer.finish_counted(settings, gpu.pass, report, number);
    else
      gpu.renderer.finish_projected(settings, gpu.pass,
                                    steps_.forecast().capacity_for(photo, model_->count()), report,
                                    number);
    if (settings.blends_surface)
      blend_surface(gpu.context, model_->gaussians.span(), rows.camera, settings, gpu.pass);
    try {
      gpu.loss->forward_backward(gpu.pass, *photo.view, loss_settings, gpu.dL_dimage);
    } catch (...) {
      // A loss of the program may say so of a picture that lacks Gaussians. It sees the step again.
      if (loss_row_ || !steps_.reports().wait(gpu.context, number).halted) throw;
      return;
    }
    blend_backward(gpu.context, settings, gradient_of_picture(gpu, photo, loss_settings, settings),
                   gpu.renderer.workspace(), gpu.pass);
    if (settings.blends_surface) compare_surface(step, i, rows, settings, gpu);
  }

  // The surface terms of photo i, which the loss has asked for. One GPU trains with them.
  void compare_surface(const PendingStep& step, std::size_t i, const PhotoRows& rows,
                       const RenderSettings& settings, Gpu& gpu) {
    const TrainingPhoto& photo = step.batch[i];
    const SurfaceWeights& weights = step.loss_settings.surface;
    std::optional<Camera> neighbor;
    gpu.surface.take_photo(gpu.context, rows.camera, gpu.photos.last());
    if (photo.neighbor && weights.photo > 0) {
      neighbor = reduced(photo.neighbor->camera, photo.reduction);
      gpu.surface.take_neighbor(gpu.context, *neighbor,
                                gpu.photos.photo(*photo.neighbor, photo.reduction));
    }
    NormalMap prior;
    if (weights.prior > 0 && photo.view->has_normal_map)
      prior = {gpu.normal_maps.of(*photo.view).values.data(), photo.view->camera.width,
               photo.reduction};
    const Span<const SurfaceRow> dL =
        gpu.surface.compare(gpu.context, rows.camera, prior, neighbor ? &*neighbor : nullptr,
                            weights, photo.patch_phase, gpu.pass);
    surface_backward(gpu.context, model_->gaussians.span(), rows.camera, settings, dL,
                     1.0f / float(step.batch.size()), i == 0, gpu.halted(),
                     gpu.renderer.workspace(), gpu.pass);
  }

  // As the scalar train_step() sets it, where the photo needs no copy of its own for that.
  static const std::uint8_t* mask_of_tiles(Gpu& gpu, const TrainingPhoto& photo,
                                           const RenderSettings& settings) {
    const View& view = *photo.view;
    if (view.over_background || gpu.loss->sees_masked_pixels() ||
        settings.fragment_statistic != FragmentStatistic::none || !gpu.photos.is_resident(view))
      return nullptr;
    return gpu.photos.photo(view, photo.reduction).mask;
  }

  // Starts to copy the photo that a GPU draws after photo i of a step, so that it arrives meanwhile.
  void prefetch_after(const PendingStep& step, std::size_t i, Gpu& gpu) {
    const std::size_t after = i + processes() * count();
    if (after < step.batch.size())
      gpu.photos.prefetch_next(*step.batch[after].view);
    else if (next_ && i % (processes() * count()) == 0)
      gpu.photos.prefetch_next(*std::exchange(next_, nullptr));
  }

  // What the loss has left, and the gradient of a depth map. The loss has asked for the photo, and so
  // for its mask.
  static PictureGradient gradient_of_picture(Gpu& gpu, const TrainingPhoto& photo,
                                             const LossSettings& loss_settings,
                                             const RenderSettings& settings) {
    PictureGradient dL{gpu.dL_dimage.span()};
    if (gpu.loss->sees_depth()) {
      gpu.loss->set_depth_gradient(dL);
      return dL;
    }
    const View& view = *photo.view;
    const auto* const map = settings.blends_depth ? &gpu.depth_maps.of(view) : nullptr;
    if (!map || map->values.empty()) return dL;
    return gpu.depth.compare(
        gpu.context,
        {map->values.data(), gpu.photos.last().mask, view.camera.width, photo.reduction, map->kind},
        loss_settings.depth_weight, gpu.dL_dimage.span(), gpu.pass);
  }

  // Gives all processes what stage 6 has left of each photo: of all rows, so that no host has to know
  // how many are visible.
  void share(const PendingStep& step, const std::vector<PhotoRows>& photos) {
    const StageScope scope(first().context, "share");
    std::vector<Processes::Piece> pieces;
    for (std::size_t i = 0; i < photos.size(); ++i) {
      const PhotoRows& photo = photos[i];
      const RenderSettings& settings = photo.settings;
      const std::size_t from = i % processes();
      const auto add = [&](auto* rows) {
        pieces.push_back({from, gpu_of(i), rows, model_->count() * sizeof *rows});
      };
      add(photo.gradients);
      if (settings.fragment_statistic != FragmentStatistic::none &&
          !sums_among_gradients(settings)) {
        if (settings.deterministic)
          add(photo.fixed_fragment_sums);
        else
          add(photo.fragment_sums);
      }
      const Span<double> look =
          photometric_.row_of(model_->photometric, step.photometric, i, photos.size());
      if (!look.empty()) pieces.push_back({from, 0, look.data, look.size * sizeof(double)});
    }
    others_->share(pieces);
    meet();
  }

  // Stages 7 and 8 for the rows of a GPU. Where a photo did not fit, nothing changes.
  void update_rows(const PendingStep& step, Gpu& gpu, Span<const PhotoRows> photos) {
    halt_with_others(gpu);
    TrainingModel& rows = rows_of(gpu);
    if (step.density.fragment_statistic() != FragmentStatistic::none)
      for (const PhotoRows& photo : photos)
        gather_fragment_sums(gpu.context, photo, rows.statistics.sums.span(), gpu.halted(),
                             gpu.place);
    if (step.poses.is_due)
      for (std::size_t i = 0; i < photos.size; ++i)
        add_camera_blocks(gpu.context, rows.gaussians.span(), photos[i], poses_.sums_of_blocks(i),
                          gpu.place);
    const bool has_surface = photos[0].settings.blends_surface;
    update_by_photos(gpu.context, rows, photos, step, gpu.halted(), gpu.place,
                     has_surface ? gpu.renderer.workspace().shape_gradients.data() : nullptr);
    if (step.density.noise.scale > 0)
      add_position_noise(gpu.context, rows.gaussians.span(), step.density.noise, step.position_rate,
                         gpu.halted(), gpu.place);
  }
  void halt_with_others(Gpu& gpu) {
    for (std::size_t other = 0; other < count(); ++other)
      if (&(*this)[other] != &gpu)
        gpu.context.launch("halt", halt_kernel, 1, 1, gpu.halted(), (*this)[other].halted());
  }

  void update_what_is_learned_of_photos(const PendingStep& step) {
    const std::uint32_t* const halted = first().halted();
    photometric_.update(model_->photometric, step.photometric, step.photos(), halted);
    if (!step.poses.is_due) return;
    for (std::size_t i = 0; i < step.batch.size(); ++i)
      poses_.add_gradient(*row_of(step.batch[i]), i, 1.0 / double(step.batch.size()));
    PoseState& poses = model_->poses;
    poses_.update(poses, pose_pulls(poses), step.poses, halted);
  }

  // The row of a photo, in runs that refine poses. A photo has the same row each time its step is
  // launched.
  std::optional<PoseRow> row_of(const TrainingPhoto& photo) const {
    const PoseState& state = model_->poses;
    if (state.empty()) return std::nullopt;
    return poses_.row_of(state, photo.photo_row, photo.view->camera);
  }

  void wait_for_launches() override { streams().synchronize(); }
  void wait_for_reports(const PendingStep& step) override {
    for (std::size_t i = 0; i < step.batch.size(); ++i)
      steps_.reports().wait(drawer_of(i).context, step.number_of(i));
  }
  void clear_failed_step() override {
    for_each([](Gpu& gpu) { gpu.clear_gradients(); });
    clear_sums();
  }
  void clear_halted_steps() override {
    for_each([](Gpu& gpu) { gpu.renderer.workspace().halted.fill_zero(); });
    clear_sums();
    if (are_several()) streams().synchronize();  // before one GPU sees the flag of another
  }
  void clear_sums() {
    photometric_.clear_gradient();
    poses_.clear_gradient();
  }

  void finish_pending() { steps_.finish(); }

  const std::size_t chunk_rows_;
  const std::unique_ptr<Processes> others_;  // null: this process is alone
  const LossRow* loss_row_ = kLosses;        // null: the program has a loss of its own
  PhotometricStage photometric_;
  PoseStage poses_;
  bool shards_are_in_use_ = false;  // they have the rows of model_
  std::unique_ptr<RowOps> rows_;
  PendingSteps steps_{*this};
  TrainingModel* model_ = nullptr;
  Gpu* last_drawer_ = &first();  // of the last photo that this process has drawn
  const View* next_ = nullptr;   // with which the next step begins, until its photo is prefetched
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

std::unique_ptr<Backend> make_backend(const std::vector<int>& devices, std::size_t chunk_rows,
                                      const Process& process) {
  GS_CHECK(!devices.empty());
  return std::make_unique<CudaBackend>(devices, chunk_rows, process);
}

}  // namespace gs::cuda
