// SPDX-License-Identifier: Apache-2.0
// The photos and masks on the GPU, as bytes. As many as fit into a budget are resident. The others
// are copied one view ahead, on a stream of their own. Photos that are not in host memory come from
// their PhotoSource. A reduced photo is computed from the whole one in each step, which takes some
// microseconds.
#pragma once

#include <unordered_map>

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"
#include "gs_core/math/loss/area_filter.h"
#include "gs_core/scene.h"

namespace gs::cuda {

/// Owns the photos. Below, "photo" means photo and mask, which lie one after the other and are
/// copied together.
class PhotoStore {
 public:
  PhotoStore(Context& context, Memory& memory);
  ~PhotoStore();
  PhotoStore(const PhotoStore&) = delete;
  PhotoStore& operator=(const PhotoStore&) = delete;

  /// Uploads the photos of these views, in order, up to so many bytes of GPU memory, and forgets
  /// all others. The views must exist until the next call or the end of this store.
  void upload_views(const std::vector<View>& views, std::size_t budget_bytes);
  /// True where upload_views() has uploaded the photo.
  bool is_resident(const View& view) const { return resident_at_.contains(&view); }
  /// Starts to copy the photo of a view that photo() will soon be called with. Waits for the GPU
  /// only where the GPU is several photos behind, and for the decoder where the photo is still
  /// being decoded.
  void prefetch_next(const View& view);
  /// The photo and its mask, reduced so many times, valid for work that is launched on the compute
  /// stream before the next call of photo(). Does not wait for a photo that is resident or was
  /// prefetched.
  PhotoBytes photo(const View& view, int reduction = 1);
  /// What the last call of photo() returned.
  const PhotoBytes& last() const { return last_; }

 private:
  // A buffer for one photo beyond the budget, with what its copy needs.
  struct Slot {
    const View* view = nullptr;  // prefetched and not yet asked for
    bool is_masked = false;
    Buffer<std::uint8_t> on_device;
    std::uint8_t* pinned = nullptr;  // the bytes to copy, in page-locked host memory
    std::size_t pinned_bytes = 0;
    cudaEvent_t arrived = nullptr;  // on the copy stream
    cudaEvent_t used = nullptr;     // on the compute stream: all work before the refill
    std::uint64_t filled = 0;       // number of the fetch that filled it
    explicit Slot(Memory& memory) : on_device(memory) {}
  };
  // The place of a resident photo in resident_.
  struct Place {
    std::size_t begin;
    bool is_masked;
  };
  PhotoBytes whole_photo(const View& view);
  PhotoBytes reduced_photo(const PhotoBytes& from, const View& view, int reduction);
  Slot& fetch(const View& view);
  Slot& oldest_free_slot();
  Slot* prefetched(const View& view);
  void reserve(Slot& slot, std::size_t bytes);
  void hand_out(const Slot* slot);

  Context& context_;
  Memory& memory_;
  cudaStream_t copy_stream_ = nullptr;
  Buffer<std::uint8_t> resident_;  // all resident photos, one after another
  std::unordered_map<const View*, Place> resident_at_;
  Buffer<std::uint8_t> reduced_;  // the reduced photo of the last call of photo()
  std::vector<Slot> slots_;
  const Slot* handed_out_[2] = {nullptr, nullptr};  // by the last two photo(); null: resident
  std::uint64_t fetches_ = 0;
  PhotoBytes last_{};
};

}  // namespace gs::cuda
