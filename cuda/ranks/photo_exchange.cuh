// SPDX-License-Identifier: Apache-2.0
// What ranks that are processes send each other of the photos of a step: splats to the rank that
// draws a photo, and their gradients back. All rows of a rank are sent, visible or not, so that no
// host has to know a count.
#pragma once

#include <vector>

#include "cuda/ranks/device_link.h"
#include "cuda/train/photo_rows.cuh"

namespace gs::cuda {

/// A photo that is under way. Its arrays have the rows of the whole model: at the rank that draws
/// it all of them are used, and elsewhere the rank's own.
struct PhotoUnderWay {
  int drawer;  // the rank
  PhotoRows rows;
  // for scores that sum over fragments apart from the gradients; else null
  Vec4f* sums;
  FixedFragmentSums* fixed_sums;
  Span<double> look;     // gradient of its appearance; may be empty
  StepReport* report;    // the drawer has written its own before send_gradients()
  std::uint32_t number;  // of the report
};

/// What the rank that has drawn photos tells the others of them.
struct DrawerStatus {
  static constexpr int kMostPhotos = kMostBatch;
  std::uint32_t halted;                  // 1: a photo had too many instances, now or earlier
  std::uint32_t instances[kMostPhotos];  // of its photos, in their order
};

class PhotoExchange {
 public:
  /// Of this rank, among `count`.
  PhotoExchange(Context& context, Memory& memory, int rank, int count)
      : context_(context), rank_(rank), count_(count), outgoing_(memory), incoming_(memory),
        statuses_(memory) {}

  /// After stage 1 of the rank's rows: each photo's drawer has the rows of all ranks.
  void send_splats(const Deal& deal, const std::vector<PhotoUnderWay>& photos, DeviceLink& link);
  /// After stage 6: each rank has the gradients of its rows, and all have the gradients of
  /// appearances. Those of other ranks' rows are zero then at the drawer. Where the photos of any
  /// drawer did not fit, `halted` is 1 on all ranks. The reports of photos of other drawers are
  /// written here.
  void send_gradients(const Deal& deal, const std::vector<PhotoUnderWay>& photos,
                      std::uint32_t* halted, DeviceLink& link);
  /// Between steps.
  void release() {
    outgoing_.release();
    incoming_.release();
  }

 private:
  // An array of a photo.
  struct Rows {
    std::byte* data;
    std::size_t row_bytes;
  };
  // An array of a photo with the rows of a rank, and its place in a message.
  struct Part {
    Rows rows;
    int rank;
    std::byte* at;
  };
  // The messages between this rank and the others.
  struct Messages {
    std::vector<Part> parts;
    std::vector<DevicePiece> pieces;
  };
  enum class Way { to_drawer, from_drawer };
  static std::vector<Rows> rows_of(const PhotoUnderWay& photo, Way way);
  // Messages of the photos that this rank draws, or of those that others draw, in `room`.
  Messages messages(const Deal& deal, const std::vector<PhotoUnderWay>& photos, Way way,
                    bool are_drawn_here, Buffer<std::byte>& room) const;
  void pack(const Deal& deal, const Messages& messages) const;
  void unpack(const Deal& deal, const Messages& messages) const;
  void exchange_status(const std::vector<PhotoUnderWay>& photos, std::uint32_t* halted,
                       std::vector<DevicePiece>& sent, std::vector<DevicePiece>& received);
  void take_status(const std::vector<PhotoUnderWay>& photos, std::uint32_t* halted) const;
  bool draws(const std::vector<PhotoUnderWay>& photos, int rank) const;

  Context& context_;
  const int rank_, count_;
  Buffer<std::byte> outgoing_, incoming_;
  Buffer<DrawerStatus> statuses_;  // of each rank
};

}  // namespace gs::cuda
