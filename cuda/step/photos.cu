// SPDX-License-Identifier: Apache-2.0
// The photos that stage 5 compares with. Resident ones lie in one buffer; the others are copied
// into slots through page-locked memory.
//
// There are four slots: two may be in use by launched work (see photo()), one holds the photo of
// the next step, and one receives the photo that is prefetched meanwhile.
#include "cuda/step/photos.cuh"

#include <cstring>

namespace gs::cuda {
namespace {

constexpr std::size_t kSlots = 4;
constexpr std::size_t kAlignment = 16;  // bytes; of the start of each resident photo
constexpr int kThreads = 256;           // values of a reduced photo are independent

constexpr std::size_t aligned(std::size_t bytes) {
  return (bytes + kAlignment - 1) / kAlignment * kAlignment;
}

// The mask lies behind the photo.
PhotoBytes photo_at(const std::uint8_t* data, const Camera& camera, bool is_masked) {
  const std::size_t photo = 3 * std::size_t(camera.width) * std::size_t(camera.height);
  return {data, is_masked ? data + photo : nullptr};
}

// Thread i has value i of the reduced photo, and the threads behind these have its mask.
__global__ void reduce_photo_kernel(PhotoBytes from, int from_width, int factor, int width,
                                    std::uint32_t pixels, std::uint8_t* to) {
  const std::uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i >= (from.mask ? 4 : 3) * pixels) return;
  const bool is_mask = i >= 3 * pixels;
  const std::uint32_t pixel = is_mask ? i - 3 * pixels : i / 3;
  const int x = int(pixel % std::uint32_t(width)), y = int(pixel / std::uint32_t(width));
  to[i] = is_mask ? reduced_mask(from, from_width, factor, x, y)
                  : reduced_value(from, from_width, factor, x, y, int(i - 3 * pixel));
}

}  // namespace

PhotoStore::PhotoStore(Context& context, Memory& memory)
    : context_(context), memory_(memory), resident_(memory), reduced_(memory) {
  check(cudaStreamCreateWithFlags(&copy_stream_, cudaStreamNonBlocking), "making a stream");
  slots_.reserve(kSlots);
  for (std::size_t i = 0; i < kSlots; ++i) {
    Slot& slot = slots_.emplace_back(memory);
    check(cudaEventCreateWithFlags(&slot.arrived, cudaEventDisableTiming), "making an event");
    check(cudaEventCreateWithFlags(&slot.used, cudaEventDisableTiming), "making an event");
  }
}

PhotoStore::~PhotoStore() {
  cudaStreamSynchronize(copy_stream_);
  for (const Slot& slot : slots_) {
    cudaEventDestroy(slot.arrived);
    cudaEventDestroy(slot.used);
    cudaFreeHost(slot.pinned);
  }
  cudaStreamDestroy(copy_stream_);
}

void PhotoStore::upload_views(const std::vector<View>& views, std::size_t budget_bytes) {
  for (Slot& slot : slots_) slot.view = nullptr;
  resident_at_.clear();
  std::size_t bytes = 0, count = 0;
  for (; count < views.size(); ++count) {
    const std::size_t end = aligned(bytes + photo_bytes(views[count]));
    if (end > budget_bytes) break;
    bytes = end;
  }
  // A growing Buffer allocates half as much again and holds old and new for a while, which would
  // exceed the budget.
  if (bytes > resident_.capacity()) resident_ = Buffer<std::uint8_t>(memory_);
  resident_.resize_discard(bytes);
  std::size_t at = 0;
  for_each_with_photo(views, count, [&](std::size_t i, const View& view) {
    const std::vector<std::uint8_t>&photo = view.photo.pixels, &mask = view.mask.pixels;
    memory_.upload(resident_.data() + at, photo.data(), photo.size());
    if (!mask.empty())
      memory_.upload(resident_.data() + at + photo.size(), mask.data(), mask.size());
    resident_at_.emplace(&views[i], Place{at, !mask.empty()});
    at = aligned(at + photo_bytes(view));
    release_photo(views[i]);
  });
}

void PhotoStore::prefetch_next(const View& view) {
  if (!is_resident(view) && !prefetched(view)) fetch(view);
}

PhotoBytes PhotoStore::photo(const View& view, int reduction) {
  last_ = whole_photo(view);
  if (reduction > 1) last_ = reduced_photo(last_, view, reduction);
  return last_;
}

PhotoBytes PhotoStore::reduced_photo(const PhotoBytes& from, const View& view, int reduction) {
  const Camera camera = reduced(view.camera, reduction);
  const std::size_t pixels = std::size_t(camera.width) * std::size_t(camera.height);
  const std::size_t bytes = (from.mask ? 4 : 3) * pixels;
  reduced_.resize_discard(bytes);
  const StageScope scope(context_, "photo");
  context_.launch("photo", reduce_photo_kernel, blocks_for(bytes, kThreads), kThreads, from,
                  view.camera.width, reduction, camera.width, std::uint32_t(pixels),
                  reduced_.data());
  return photo_at(reduced_.data(), camera, from.mask != nullptr);
}

PhotoBytes PhotoStore::whole_photo(const View& view) {
  const auto resident = resident_at_.find(&view);
  if (resident != resident_at_.end()) {
    hand_out(nullptr);
    return photo_at(resident_.data() + resident->second.begin, view.camera,
                    resident->second.is_masked);
  }
  Slot* slot = prefetched(view);
  if (!slot) slot = &fetch(view);
  check(cudaStreamWaitEvent(context_.stream(), slot->arrived), "waiting for a photo");
  // A prefetch is for one call: later the view may be gone, and another view may have its address.
  slot->view = nullptr;
  hand_out(slot);
  return photo_at(slot->on_device.data(), view.camera, slot->is_masked);
}

PhotoStore::Slot* PhotoStore::prefetched(const View& view) {
  for (Slot& slot : slots_)
    if (slot.view == &view) return &slot;
  return nullptr;
}

void PhotoStore::hand_out(const Slot* slot) {
  handed_out_[0] = handed_out_[1];
  handed_out_[1] = slot;
}

PhotoStore::Slot& PhotoStore::oldest_free_slot() {
  Slot* oldest = nullptr;
  for (Slot& slot : slots_) {
    if (&slot == handed_out_[0] || &slot == handed_out_[1]) continue;
    if (!oldest || slot.filled < oldest->filled) oldest = &slot;
  }
  return *oldest;
}

// Copies the bytes into page-locked memory at once. The copy to the GPU begins when all work
// launched so far has run.
PhotoStore::Slot& PhotoStore::fetch(const View& view) {
  const std::shared_ptr<const View> decoded = with_photo(view);  // may wait for the decoder
  const std::vector<std::uint8_t>&photo = decoded->photo.pixels, &mask = decoded->mask.pixels;
  const std::size_t bytes = photo.size() + mask.size();
  Slot& slot = oldest_free_slot();
  slot.view = nullptr;                                            // if anything throws
  check(cudaEventSynchronize(slot.arrived), "fetching a photo");  // the pinned bytes are free again
  reserve(slot, bytes);
  std::memcpy(slot.pinned, photo.data(), photo.size());
  if (!mask.empty()) std::memcpy(slot.pinned + photo.size(), mask.data(), mask.size());
  check(cudaEventRecord(slot.used, context_.stream()), "fetching a photo");
  check(cudaStreamWaitEvent(copy_stream_, slot.used), "fetching a photo");
  check(cudaMemcpyAsync(slot.on_device.data(), slot.pinned, bytes, cudaMemcpyHostToDevice,
                        copy_stream_),
        "fetching a photo");
  check(cudaEventRecord(slot.arrived, copy_stream_), "fetching a photo");
  slot.view = &view;
  slot.is_masked = !mask.empty();
  slot.filled = ++fetches_;
  return slot;
}

void PhotoStore::reserve(Slot& slot, std::size_t bytes) {
  slot.on_device.resize_discard(bytes);
  if (bytes <= slot.pinned_bytes) return;
  cudaFreeHost(slot.pinned);
  slot.pinned = nullptr, slot.pinned_bytes = 0;
  check(cudaMallocHost(&slot.pinned, bytes), "allocating memory for a photo");
  slot.pinned_bytes = bytes;
}

}  // namespace gs::cuda
