// SPDX-License-Identifier: Apache-2.0
// Fusion on a GPU. Views stay on it. The formulas are those of gs_render/fusion, with no product and
// sum fused, so that blocks and voxels have the bytes of the CPU.
#include "gs_render/fusion/fusion.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "cuda/device/warp.cuh"
#include "cuda/fusion/surface_depth.cuh"
#include "gs_render/fusion/agreement.h"
#include "gs_render/fusion/votes.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // pixels and blocks are independent: any size that fills the GPU
constexpr std::size_t kBlocksAtOnce = std::size_t(1) << 24;  // of a frame, a byte each
// Bits of 512 MiB. A frame of more blocks is marked on the CPU.
constexpr std::uint64_t kMostMarked = std::uint64_t(1) << 32;

/// The pixel of this thread; false behind the last one.
__device__ bool find_pixel(const DepthPicture& view, int& x, int& y) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  x = int(i % view.camera.width);
  y = int(i / view.camera.width);
  return y < view.camera.height;
}

__global__ void facing_kernel(DepthPicture view, std::uint8_t* facing) {
  if (int x, y; find_pixel(view, x, y)) facing[view.pixel(x, y)] = view.facing_of(x, y);
}

__global__ void doubt_kernel(Span<const DepthPicture> views, std::size_t view, char* doubtful) {
  if (int x, y; find_pixel(views[view], x, y))
    doubtful[views[view].pixel(x, y)] = is_doubtful(views, view, x, y);
}

__global__ void forget_kernel(DepthPicture view, const char* doubtful, float* inverse_depth) {
  int x, y;
  if (!find_pixel(view, x, y) || !doubtful[view.pixel(x, y)]) return;
  inverse_depth[view.pixel(x, y)] = kUnknownDepth;
}

/// A bit for each block of the frame.
__global__ void mark_kernel(DepthPicture view, VolumeFrame frame, FusionRule rule,
                            std::uint32_t* marks) {
  int x, y;
  if (!find_pixel(view, x, y) || !view.has(x, y)) return;
  for_blocks_near(frame, rule, view.world_point(x, y), [&](auto... place) {
    const std::uint64_t key = frame.key(place...);
    const std::uint32_t bit = 1u << key % 32;
    if (!(marks[key / 32] & bit)) atomicOr(&marks[key / 32], bit);  // most are marked already
  });
}

/// Views and what is asked of them.
struct VotingViews {
  Span<const DepthPicture> views;
  VolumeFrame frame;
  FusionRule rule;
  int least;

  __device__ float truncation() const { return rule.truncation * frame.voxel; }
  __device__ float distance(const Votes& votes) const {
    return votes.distance(least, rule.is_watertight);
  }
};

__global__ void air_kernel(VotingViews voting, std::uint64_t first, Span<char> is_air) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= is_air.size) return;
  const std::uint64_t key = first + i;
  is_air[i] = 1;
  if (voting.frame.is_border(key)) return;
  Votes votes;
  for (const DepthPicture& view : voting.views)
    votes.add(view, voting.frame.corner(key), voting.truncation());
  is_air[i] = voting.distance(votes) >= 0;
}

/// A thread block has a block of voxels, a voxel a thread. Its first warp finds which of the next 32
/// views see the block, and puts them into shared memory in their order.
__global__ void __launch_bounds__(kBlockVoxels)
    fill_kernel(VotingViews voting, const std::uint64_t* keys, const BlockKind* kinds,
                float* distance) {
  __shared__ alignas(DepthPicture) unsigned char seeing_bytes[kWarp * sizeof(DepthPicture)];
  __shared__ int seeing_count;
  DepthPicture* const seeing = reinterpret_cast<DepthPicture*>(seeing_bytes);
  const int v = int(threadIdx.x);
  float& to = distance[std::size_t(blockIdx.x) * kBlockVoxels + v];
  if (const BlockKind kind = kinds[blockIdx.x]; kind != BlockKind::mixed) {  // the whole block
    to = float(kind);
    return;
  }
  const VolumeFrame& frame = voting.frame;
  const Vec3f corner = frame.corner(keys[blockIdx.x]), p = frame.voxel_at(corner, v);
  Votes votes;
  for (std::size_t first = 0; first < voting.views.size; first += kWarp) {
    if (v < kWarp) {
      const std::size_t view = first + std::size_t(v);
      const bool sees =
          view < voting.views.size && sees_block(voting.views[view].camera, frame, corner);
      const unsigned all = __ballot_sync(kAllLanes, sees);
      if (sees) seeing[__popc(all & lanes_below())] = voting.views[view];
      if (v == 0) seeing_count = __popc(all);
    }
    __syncthreads();
    for (int i = 0; i < seeing_count; ++i) votes.add(seeing[i], p, voting.truncation());
    __syncthreads();
  }
  to = voting.distance(votes);
}

/// The arrays of a view on the GPU.
struct ViewOnDevice {
  Camera camera;
  Buffer<float> inverse_depth;
  Buffer<std::uint8_t> facing;

  ViewOnDevice(const Camera& camera_, Memory& memory)
      : camera(camera_), inverse_depth(std::size_t(camera_.width) * camera_.height, memory),
        facing(inverse_depth.size(), memory) {}
  DepthPicture picture() const { return {camera, inverse_depth.data(), facing.data()}; }
  std::size_t blocks() const { return blocks_for(inverse_depth.size(), kThreads); }
};

class CudaFusion final : public Fusion {
 public:
  CudaFusion(Context& context, Memory& memory, const FusionRule& rule)
      : Fusion(rule), context_(context), memory_(memory), planes_(memory), pictures_(memory),
        marks_(memory), is_air_(memory), keys_(memory), kinds_(memory), distance_(memory) {}

  void add(DepthView view) override {
    const ViewOnDevice& to = on_device_.emplace_back(view.camera, memory_);
    memory_.upload(to.inverse_depth.data(), view.inverse_depth.pixels.data(),
                   to.inverse_depth.size_bytes());
    memory_.upload(to.facing.data(), view.facing.data(), to.facing.size_bytes());
    Fusion::add(std::move(view));
  }
  void add(const GaussiansSpan& gaussians, const Camera& camera, const RenderSettings& settings,
           const RenderPass& pass, Image8 color) override {
    const ViewOnDevice& to = on_device_.emplace_back(camera, memory_);
    find_surface_depth(context_, gaussians, camera, settings, pass, planes_,
                       to.inverse_depth.data());
    context_.launch("facing", facing_kernel, to.blocks(), kThreads, to.picture(), to.facing.data());
    DepthView view{camera, ImageF(camera.width, camera.height, 1), to.facing.download(),
                   std::move(color)};
    memory_.download(view.inverse_depth.pixels.data(), to.inverse_depth.data(),
                     to.inverse_depth.size_bytes());
    Fusion::add(std::move(view));
  }

  void drop_doubtful() override {
    if (on_device_.size() < 2) return;
    const Span<const DepthPicture> pictures = all_pictures();
    std::vector<Buffer<char>> doubtful;
    for (std::size_t v = 0; v < on_device_.size(); ++v) {
      const ViewOnDevice& view = on_device_[v];
      doubtful.emplace_back(view.inverse_depth.size(), memory_);
      context_.launch("doubt", doubt_kernel, view.blocks(), kThreads, pictures, v,
                      doubtful.back().data());
    }
    for (std::size_t v = 0; v < on_device_.size(); ++v) {
      const ViewOnDevice& view = on_device_[v];
      context_.launch("forget", forget_kernel, view.blocks(), kThreads, view.picture(),
                      doubtful[v].data(), view.inverse_depth.data());
      memory_.download(views_[v].inverse_depth.pixels.data(), view.inverse_depth.data(),
                       view.inverse_depth.size_bytes());
    }
  }

  std::vector<std::uint64_t> surface_blocks(const VolumeFrame& frame) override {
    if (frame.count() > kMostMarked) return Fusion::surface_blocks(frame);
    marks_.resize_discard((frame.count() + 31) / 32);
    marks_.fill_zero();
    for (const ViewOnDevice& view : on_device_)
      context_.launch("surface blocks", mark_kernel, view.blocks(), kThreads, view.picture(), frame,
                      rule_, marks_.data());
    const std::vector<std::uint32_t> marks = marks_.download();
    std::vector<std::uint64_t> keys;
    for (std::size_t word = 0; word < marks.size(); ++word)
      for (std::uint32_t left = marks[word]; left != 0; left &= left - 1)
        keys.push_back(32 * word + std::uint64_t(std::countr_zero(left)));
    return keys;
  }

 protected:
  std::vector<char> air_at_corners(const VolumeFrame& frame) override {
    std::vector<char> is_air(frame.count());
    for (std::size_t first = 0; first < is_air.size(); first += kBlocksAtOnce) {
      is_air_.resize_discard(std::min(kBlocksAtOnce, is_air.size() - first));
      context_.launch("air", air_kernel, blocks_for(is_air_.size(), kThreads), kThreads,
                      voting(frame), std::uint64_t(first), is_air_.span());
      memory_.download(&is_air[first], is_air_.data(), is_air_.size());
    }
    return is_air;
  }
  void fill(const VolumeFrame& frame, Span<const std::uint64_t> keys, Span<const BlockKind> kinds,
            float* distance) override {
    keys_.resize_discard(keys.size);
    kinds_.resize_discard(kinds.size);
    distance_.resize_discard(keys.size * kBlockVoxels);
    memory_.upload(keys_.data(), keys.data, keys_.size_bytes());
    memory_.upload(kinds_.data(), kinds.data, kinds_.size_bytes());
    context_.launch("fusion", fill_kernel, keys.size, kBlockVoxels, voting(frame), keys_.data(),
                    kinds_.data(), distance_.data());
    memory_.download(distance, distance_.data(), distance_.size_bytes());
  }

 private:
  Span<const DepthPicture> all_pictures() {
    if (pictures_.size() != on_device_.size()) {
      std::vector<DepthPicture> pictures;
      for (const ViewOnDevice& view : on_device_) pictures.push_back(view.picture());
      pictures_.upload(pictures);
    }
    return pictures_.span();
  }
  VotingViews voting(const VolumeFrame& frame) {
    return {all_pictures(), frame, rule_, least_views()};
  }

  Context& context_;
  Memory& memory_;
  std::vector<ViewOnDevice> on_device_;
  Buffer<SplatPlane<float>> planes_;
  Buffer<DepthPicture> pictures_;  // of on_device_
  Buffer<std::uint32_t> marks_;
  Buffer<char> is_air_;
  Buffer<std::uint64_t> keys_;
  Buffer<BlockKind> kinds_;
  Buffer<float> distance_;
};

}  // namespace

std::unique_ptr<Fusion> make_fusion(Context& context, Memory& memory, const FusionRule& rule) {
  return std::make_unique<CudaFusion>(context, memory, rule);
}

}  // namespace gs::cuda
