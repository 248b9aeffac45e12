// SPDX-License-Identifier: Apache-2.0
// What a rank that is a process computes with: the CPU, or one GPU that is linked to those of the
// other ranks.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "gs_train/backend.h"
#include "gs_train/ranks/peer_ranks.h"

namespace gs {

class RankDevice {
 public:
  virtual ~RankDevice() = default;
  /// The backend of rank 0, whose other ranks are behind `peers`. Once.
  virtual std::unique_ptr<Backend> backend(std::vector<PeerSocket> peers, PeerRules rules) = 0;
  /// The work of another rank, as work_as_rank(). Once.
  virtual void work(PeerSocket& leader, int rank, int count, double deadline,
                    const std::vector<View>& views, const PhotometricConfig& photometric) = 0;
};

/// The device of train.device. Throws UsageError where something is missing to link GPUs, and Error
/// where this build or the machine has none.
///
/// gpu   the number of the GPU, of `visible` ones, where train.device names the one `first`
std::unique_ptr<RankDevice> make_rank_device(const TrainConfig& train,
                                             const std::function<int(int first, int visible)>& gpu);

}  // namespace gs
