// SPDX-License-Identifier: Apache-2.0
// The operator: the stages of a picture, and those of its gradient, in order.
#include "cuda/backend.h"

#include <atomic>
#include <mutex>
#include <vector>

#include "cuda/operator/caller_memory.cuh"
#include "cuda/operator/stages.cuh"
#include "cuda/render/instance_buffer.cuh"
#include "cuda/render/renderer.cuh"
#include "cuda/render/reports.cuh"

namespace gs::cuda {
namespace {

struct Frame final : OperatorFrame {
  explicit Frame(const OperatorCall& call)
      : context(call.device, static_cast<cudaStream_t>(call.stream)), memory(context, call.kept),
        pass(memory), halted(memory) {}
  const float* transmittance() const override { return pass.transmittance.data(); }
  std::uint32_t instances() const override { return count; }

  Context context;
  CallerMemory memory;
  RenderPass pass;
  Buffer<std::uint32_t> halted;  // (1) with a room
  std::uint32_t count = 0;
};

// Sizes what the gradient reads of a picture with a room, always in this order.
void lay_out(const OperatorInput& input, const RenderSettings& settings, Frame& frame) {
  RenderPass& pass = frame.pass;
  CudaScratch& scratch = pass.scratch<CudaScratch>();
  pass.begin(input.camera, 0);
  pass.least_color = least_color(input);
  const std::size_t tiles = pass.tile_count(), pixels = pass.pixel_count();
  const std::size_t checkpoints = checkpoint_pixels(input.room);
  pass.splats.resize_discard(input.count);
  pass.tile_counts.resize_discard(input.count);
  pass.tile_splats.resize_discard(input.room);
  pass.tile_ranges.resize_discard(tiles + 1);
  pass.image.resize_discard(3 * pixels);
  pass.transmittance.resize_discard(pixels);
  pass.last_instance.resize_discard(pixels);
  pass.depth_image.resize_discard(settings.blends_depth ? pixels : 0);
  scratch.tile_order.resize_discard(tiles);
  scratch.first_checkpoints.resize_discard(tiles);
  scratch.segments.resize_discard(most_segments(tiles, input.room));
  scratch.instance_buffer.resize_discard(checkpoints);
  scratch.depth_checkpoints.resize_discard(settings.blends_depth ? checkpoints : 0);
  frame.halted.resize_discard(1);
}

// The buffers that lay_out() sizes.
std::vector<const ByteBuffer*> kept_buffers(const Frame& frame) {
  const RenderPass& pass = frame.pass;
  const CudaScratch& scratch = pass.scratch<CudaScratch>();
  return {&pass.splats,
          &pass.tile_counts,
          &pass.tile_splats,
          &pass.tile_ranges,
          &pass.image,
          &pass.transmittance,
          &pass.last_instance,
          &pass.depth_image,
          &scratch.tile_order,
          &scratch.first_checkpoints,
          &scratch.segments,
          &scratch.instance_buffer,
          &scratch.depth_checkpoints,
          &frame.halted};
}

// Page-locked memory for the report of one call. It is slow to make, so that calls hand it on.
class BorrowedReports {
 public:
  BorrowedReports() {
    const std::scoped_lock lock(mutex());
    if (unused().empty()) {
      reports_ = std::make_unique<Reports>(1);
    } else {
      reports_ = std::move(unused().back());
      unused().pop_back();
    }
  }
  ~BorrowedReports() {
    const std::scoped_lock lock(mutex());
    unused().push_back(std::move(reports_));
  }
  Reports& operator*() const { return *reports_; }

  /// A number that no earlier call has had.
  static std::uint32_t next_number() {
    static std::atomic<std::uint32_t> last{0};
    std::uint32_t number;
    while ((number = ++last) == 0) {  // that of a report that nobody has written
    }
    return number;
  }

 private:
  // Neither is ever freed: at the end of the process the driver may be gone before them.
  static std::mutex& mutex() {
    static auto& mutex = *new std::mutex;
    return mutex;
  }
  static std::vector<std::unique_ptr<Reports>>& unused() {
    static auto& unused = *new std::vector<std::unique_ptr<Reports>>;
    return unused;
  }
  std::unique_ptr<Reports> reports_;
};

// Waits for the device.
std::uint32_t count_instances(Context& context, const RenderSettings& settings,
                              Workspace& workspace, const RenderPass& pass) {
  if (pass.tile_counts.empty()) return 0;
  const BorrowedReports borrowed;
  const std::uint32_t number = BorrowedReports::next_number();
  report_instances(context, settings, workspace, pass, (*borrowed).of_step(number), number);
  const std::uint32_t instances = (*borrowed).wait(context, number).instances;
  check_can_be_sorted(instances);
  return instances;
}

constexpr int kThreads = 256;

// Copies what a pass keeps to what the caller gets.
__global__ void __launch_bounds__(kThreads)
    copy_picture_kernel(std::size_t pixels, const float* image, const float* transmittance,
                        const float* depth, const std::uint32_t* halted, OperatorPicture to) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= pixels) return;
  if (i == 0 && to.overflowed) *to.overflowed = *halted;
  if (to.image)
    for (int c = 0; c < 3; ++c) to.image[c * pixels + i] = image[c * pixels + i];
  if (to.alpha) to.alpha[i] = 1.0f - transmittance[i];
  if (to.depth) to.depth[i] = depth[i];
}

// OperatorPicture::rows of one Gaussian for each thread.
__global__ void __launch_bounds__(kThreads)
    tell_rows_kernel(std::size_t count, const Splat* splats, bool has_inverse_depth,
                     const std::uint32_t* tile_counts, float* rows) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= count) return;
  float* const to = rows + kRowNumbers * i;
  if (tile_counts[i] == 0) {
    for (int k = 0; k < kRowNumbers; ++k) to[k] = 0;
    return;
  }
  const Splat& splat = splats[i];
  const Sym2<float>& conic = splat.conic;
  const float half = (conic.xx - conic.yy) / 2;
  const float smallest = (conic.xx + conic.yy) / 2 - hypotf(half, conic.xy);  // eigenvalue
  to[0] = 1;
  to[1] = ceilf(fminf(fmaxf(sqrtf(2 * splat.cutoff / smallest), 1.0f), 1e9f));
  to[2] = splat.mean2d.x;
  to[3] = splat.mean2d.y;
  to[4] = has_inverse_depth ? 1.0f / splat.depth : splat.depth;
  to[5] = conic.xx;
  to[6] = conic.xy;
  to[7] = conic.yy;
}

// About the bytes that the buffers of stages 1 to 4 take, so that few pieces are asked for.
struct Expected {
  std::size_t of_rows, of_scratch_rows, of_instances, of_scratch_instances;

  Expected(std::size_t rows, std::size_t pixels, std::size_t instances) {
    constexpr std::size_t kRow = sizeof(Splat) + sizeof(float) + sizeof(Rect) + 2 * sizeof(float);
    of_rows = rows * (kRow + 8) + (1 << 16);
    of_scratch_rows = rows * 16 + (1 << 16);
    of_instances = instances * 20 + pixels * 24 + (1 << 16);
    of_scratch_instances = instances / 4 + (1 << 16);
  }
};

class CudaOperator final : public SplatOperator {
 public:
  std::unique_ptr<OperatorFrame> draw(const OperatorCall& call, const OperatorInput& input,
                                      const RenderSettings& given,
                                      const OperatorPicture& to) const override {
    const OnDevice here(call.device);
    RenderSettings settings = given;
    if (to.features) settings.for_backward = true;  // features need each pixel's last fragment
    auto frame = std::make_unique<Frame>(call);
    Context& context = frame->context;
    RenderPass& pass = frame->pass;
    CallerMemory scratch(context, call.scratch);
    Workspace workspace(scratch);
    const std::size_t pixels = std::size_t(input.camera.width) * input.camera.height;
    const Expected first(input.count, pixels, 0);
    frame->memory.expect(first.of_rows);
    scratch.expect(first.of_scratch_rows);
    project(context, input, settings, workspace, pass);
    if (input.room > 0) {
      frame->halted.resize(1);
      frame->halted.fill_zero();
      // Each visible Gaussian has an instance. One row more shows that there are too many.
      order_by_depth(context, settings, workspace, pass, std::size_t(input.room) + 1);
      frame->count = input.room;
    } else {
      order_by_depth(context, settings, workspace, pass, input.count);
      frame->count = count_instances(context, settings, workspace, pass);
    }
    const Expected then(input.count, pixels, frame->count);
    frame->memory.expect(then.of_instances);
    scratch.expect(then.of_scratch_instances);
    const InstanceLimit limit{std::max(frame->count, 1u), frame->halted.data()};
    create_instances(context, settings, workspace, pass, limit);
    sort_by_tile(context, settings, workspace, pass, limit.capacity);
    blend(context, settings, pass);
    if (to.features) blend_features(context, settings, pass, input, to.features);
    context.launch("copy of the picture", copy_picture_kernel, blocks_for(pixels, kThreads),
                   kThreads, pixels, pass.image.data(), pass.transmittance.data(),
                   pass.depth_image.data(), frame->halted.data(), to);
    if (to.rows)
      context.launch("what is told of Gaussians", tell_rows_kernel,
                     blocks_for(input.count, kThreads), kThreads, input.count, pass.splats.data(),
                     input.has_inverse_depth, pass.tile_counts.data(), to.rows);
    frame->memory.close();
    return frame;
  }

  void pull_back(const OperatorCall& call, const OperatorFrame& frame, const OperatorInput& input,
                 const RenderSettings& settings, const OperatorPictureGradient& dL,
                 const OperatorGradients& gradients) const override {
    const OnDevice here(call.device);
    const Frame& drawn = static_cast<const Frame&>(frame);
    const RenderPass& pass = drawn.pass;
    Context context(call.device, static_cast<cudaStream_t>(call.stream));
    CallerMemory scratch(context, call.scratch);
    Workspace workspace(scratch);
    const std::size_t rows = input.count, pixels = pass.pixel_count();
    constexpr std::size_t kFixed = sizeof(FineSums) + sizeof(CoarseSums);
    scratch.expect(rows * (sizeof(SplatGradientSum) + (settings.deterministic ? kFixed : 0)) +
                   (dL.image ? 0 : 3 * pixels * sizeof(float)) + (1 << 16));
    const auto zeros = [](auto& buffer, std::size_t size) {
      buffer.resize_discard(size);
      buffer.fill_zero();
    };
    zeros(workspace.splat_gradients, rows);
    if (settings.deterministic) {
      zeros(workspace.fine_sums, rows);
      zeros(workspace.coarse_sums, rows);
    }
    Buffer<float> no_image(scratch);
    if (dL.image || dL.alpha || dL.depth) {
      if (!dL.image) zeros(no_image, 3 * pixels);
      const PictureGradient dL_dpicture{{dL.image ? dL.image : no_image.data(), 3 * pixels},
                                        {dL.alpha, dL.alpha ? pixels : 0},
                                        {dL.depth, dL.depth ? pixels : 0}};
      blend_backward(context, settings, dL_dpicture, workspace, pass);
    }
    if (gradients.features)
      check(cudaMemsetAsync(gradients.features, 0, rows * input.channels * sizeof(float),
                            context.stream()),
            "gradient by features");
    if (dL.features)
      blend_features_backward(context, settings, pass, input, dL, drawn.halted.data(), workspace,
                              gradients.features);
    project_backward(context, input, settings, workspace, pass, drawn.halted.data(), gradients);
  }

  std::size_t kept_bytes(const OperatorInput& input,
                         const RenderSettings& settings) const override {
    std::size_t bytes = 0;
    OperatorCall counting;
    counting.kept = [&bytes](std::size_t piece) {  // addresses that nobody reads
      bytes += piece;
      return reinterpret_cast<void*>(bytes);
    };
    Frame frame(counting);
    lay_out(input, settings, frame);
    return bytes;
  }

  std::unique_ptr<OperatorFrame> frame_in(const OperatorCall& call, const OperatorInput& input,
                                          const RenderSettings& settings,
                                          const OperatorFrame* copied) const override {
    const OnDevice here(call.device);
    auto frame = std::make_unique<Frame>(call);
    lay_out(input, settings, *frame);
    frame->memory.close();
    frame->count = input.room;
    if (copied) {
      const auto from = kept_buffers(static_cast<const Frame&>(*copied));
      const auto to = kept_buffers(*frame);
      for (std::size_t i = 0; i < to.size(); ++i) {
        GS_CHECK(from[i]->size() >= to[i]->size());
        if (!to[i]->empty())
          frame->memory.copy(to[i]->bytes(), from[i]->bytes(), to[i]->size_bytes());
      }
    }
    return frame;
  }

  void footprints(const OperatorCall& call, const OperatorInput& input,
                  const SplatSettings& settings, const FootprintRule& rule,
                  const OperatorFootprints& to) const override {
    const OnDevice here(call.device);
    Context context(call.device, static_cast<cudaStream_t>(call.stream));
    cuda::footprints(context, input, settings, rule, to);
  }

  void compare(const OperatorCall& call, const OperatorComparison& given, float* value,
               float* dL_dimage) const override {
    const OnDevice here(call.device);
    Context context(call.device, static_cast<cudaStream_t>(call.stream));
    CallerMemory scratch(context, call.scratch);
    compare_pictures(context, scratch, given, value, dL_dimage);
  }
};

}  // namespace

const SplatOperator& splat_operator() {
  static const CudaOperator one;
  return one;
}

}  // namespace gs::cuda
