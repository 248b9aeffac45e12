// SPDX-License-Identifier: Apache-2.0
// A model is dealt to GPUs, and merged again, by copies of chunks of rows. Chunks are equally far
// from each other in the model and in a shard, so that one copy covers all but the last, short one.
#include <string>

#include "cuda/gpus/gpu.cuh"

namespace gs::cuda {
namespace {

// Lets all these GPUs read and write each other's memory.
void connect(const std::vector<int>& devices) {
  for (const int from : devices)
    for (const int to : devices) {
      if (from == to) continue;
      int is_possible = 0;
      check(cudaDeviceCanAccessPeer(&is_possible, from, to), "asking how GPUs are connected");
      if (!is_possible)
        throw UsageError("GPU " + std::to_string(from) + " cannot read the memory of GPU " +
                         std::to_string(to) +
                         ", which training on several GPUs needs; choose others with "
                         "CUDA_VISIBLE_DEVICES, or train on one (--gpus 1)");
      const OnDevice here(from);
      const cudaError_t error = cudaDeviceEnablePeerAccess(to, 0);
      if (error == cudaErrorPeerAccessAlreadyEnabled)
        cudaGetLastError();  // the next call starts clean
      else
        check(error, "connecting GPUs");
    }
}

enum class Way { to_shard, to_model };

// Copies the rows of a column between the model and the shard of a GPU.
void copy_rows(Way way, const Gpu& gpu, const ByteBuffer& model, const ByteBuffer& shard) {
  const Shard& place = gpu.place;
  GS_CHECK(model.size() == place.all_rows && shard.size() == place.count() &&
           shard.row_bytes() == model.row_bytes());
  const auto copy = [&](std::size_t local, std::size_t rows, std::size_t chunks) {
    if (rows * chunks == 0) return;
    std::byte* const in_model = model.row(place.row_of_all(local));
    std::byte* const in_shard = shard.row(local);
    const std::size_t bytes = rows * model.row_bytes(), step = place.gpus * bytes;
    const bool is_out = way == Way::to_shard;
    check(cudaMemcpy2DAsync(is_out ? in_shard : in_model, is_out ? bytes : step,
                            is_out ? in_model : in_shard, is_out ? step : bytes, bytes, chunks,
                            cudaMemcpyDefault, gpu.context.stream()),
          "copying rows between GPUs");
  };
  const std::size_t full = shard.size() / place.chunk_rows(), end = full * place.chunk_rows();
  copy(0, place.chunk_rows(), full);
  copy(end, shard.size() - end, 1);
}

void copy_rows(Way way, const Gpu& gpu, const TrainingModel& model) {
  const ConstColumns all = model.columns(), of_shard = gpu.shard.columns();
  for (std::size_t k = 0; k < all.size(); ++k) copy_rows(way, gpu, *all[k].rows, *of_shard[k].rows);
}

}  // namespace

Gpu::Gpu(int device, Streams& streams)
    : context(device), memory(context, streams), photos(context, memory), renderer(context, memory),
      pass(memory), photo_buffers(memory), dL_dimage(memory), depth_maps(memory, &View::depth),
      normal_maps(memory, &View::normals), depth(memory), surface(memory), shard(memory) {
  streams.add(context);
  check(cudaEventCreateWithFlags(&launched, cudaEventDisableTiming), "making an event");
}

Gpu::~Gpu() { cudaEventDestroy(launched); }

void Gpu::clear_gradients() {
  renderer.clear_gradients();
  photo_buffers.clear_gradients();
}

void Gpu::release_step() {
  renderer.release_caches();
  for (ByteBuffer* const rows : std::initializer_list<ByteBuffer*>{
           &pass.tile_counts, &pass.depth_order, &pass.tile_splats, &pass.surface_rows})
    rows->release();
  photo_buffers.release();  // its gradients are zero between steps
  pass.scratch<CudaScratch>().instance_buffer.release();
}

void Gpu::release_caches() {
  pass = RenderPass(memory);
  renderer.release_caches();
  photo_buffers.release();
  dL_dimage.release();
  depth.release();
  surface.release();
}

Gpus::Gpus(const std::vector<int>& devices) {
  connect(devices);
  for (const int device : devices) all_.push_back(std::make_unique<Gpu>(device, streams_));
  check(cudaSetDevice(devices.front()), "choosing the GPU");
}

Gpus::~Gpus() {
  streams_.wait();
  streams_.forget();
}

void Gpus::meet() {
  if (!are_several()) return;
  for_each([](Gpu& gpu) {
    check(cudaEventRecord(gpu.launched, gpu.context.stream()), "marking a stream");
  });
  for (const std::unique_ptr<Gpu>& gpu : all_)
    for (const std::unique_ptr<Gpu>& other : all_)
      if (gpu != other)
        check(cudaStreamWaitEvent(gpu->context.stream(), other->launched, 0),
              "waiting for a stream");
}

void Gpus::deal_out(const TrainingModel& model, std::size_t chunk_rows) {
  streams_.synchronize();
  for (std::size_t i = 0; i < count(); ++i) {
    Gpu& gpu = *all_[i];
    gpu.place = Shard(int(i), int(count()), model.count(), chunk_rows);
    gpu.shard.match_columns(model);
    for (const Column& column : gpu.shard.columns()) column.rows->resize_discard(gpu.place.count());
  }
  for_each([&](Gpu& gpu) { copy_rows(Way::to_shard, gpu, model); });
  streams_.synchronize();
}

void Gpus::merge(const TrainingModel& model) {
  streams_.synchronize();
  for_each([&](Gpu& gpu) { copy_rows(Way::to_model, gpu, model); });
  streams_.synchronize();
}

}  // namespace gs::cuda
