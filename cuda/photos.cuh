// SPDX-License-Identifier: Apache-2.0
// The photos on the GPU with their masks, as bytes: all of them while they fit into a budget; the others are fetched one view
// ahead on a stream of their own. Photos that are no longer, or not yet, in host memory come from their PhotoSource.
#pragma once

#include <unordered_map>

#include "cuda/context.cuh"
#include "gs_core/buffer.h"
#include "gs_core/scene.h"

namespace gs::cuda {

/// One view's bytes on the GPU.
struct PhotoBytes {
  const std::uint8_t* photo;  // (height, width, 3)
  const std::uint8_t* mask;   // (height, width); null: every pixel trains
};

/// "Photo" stands for photo and mask: they lie one after the other, and travel together.
class PhotoStore {
 public:
  PhotoStore(Context& context, Memory& memory);
  ~PhotoStore();
  PhotoStore(const PhotoStore&) = delete;
  PhotoStore& operator=(const PhotoStore&) = delete;

  /// Uploads the photos of these views, in order, up to so many bytes of the GPU's memory; forgets all others.
  /// The views outlive the next call or this store.
  void upload_views(const std::vector<View>& views, std::size_t budget_bytes);
  /// Whether the photo was prepared.
  bool is_resident(const View& view) const { return resident_at_.contains(&view); }
  /// Starts to fetch the photo of a view that photo() will be asked for soon. Does not wait for the GPU but
  /// where it is several photos behind; waits for a photo that is still being decoded.
  void prefetch_next(const View& view);
  /// The photo and its mask, valid for work on the compute stream that is launched
  /// before the next two calls of photo(). Does not wait for a photo that was prepared or announced.
  PhotoBytes photo(const View& view);

 private:
  // A place for one photo that does not fit the budget, and its way there.
  struct Slot {
    const View* view = nullptr;      // announced and not yet asked for
    bool is_masked = false;
    Buffer<std::uint8_t> on_device;
    std::uint8_t* pinned = nullptr;  // the bytes on their way, in page-locked host memory
    std::size_t pinned_bytes = 0;
    cudaEvent_t arrived = nullptr;   // on the copy stream
    cudaEvent_t used = nullptr;      // on the compute stream: the last work that was launched before the slot is refilled
    std::uint64_t filled = 0;        // number of the fetch
    explicit Slot(Memory& memory) : on_device(memory) {}
  };
  // Where a resident photo begins.
  struct Place {
    std::size_t begin;
    bool is_masked;
  };
  Slot& fetch(const View& view);
  Slot& oldest_free_slot();
  Slot* announced(const View& view);
  void make_room(Slot& slot, std::size_t bytes);
  void hand_out(const Slot* slot);

  Context& context_;
  Memory& memory_;
  cudaStream_t copy_stream_ = nullptr;
  Buffer<std::uint8_t> resident_;                              // all resident photos, one after another
  std::unordered_map<const View*, Place> resident_at_;
  std::vector<Slot> slots_;
  const Slot* handed_out_[2] = {nullptr, nullptr};             // by the last two calls of photo(), null if resident
  std::uint64_t fetches_ = 0;
};

}  // namespace gs::cuda
