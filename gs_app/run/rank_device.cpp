// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/rank_device.h"

#include <utility>

#include "gs_app/run/make_backend.h"
#include "gs_core/error.h"
#include "gs_train/ranks/ranked_backend.h"

#ifdef GS_HAVE_CUDA
#include "cuda/backend.h"
#endif

namespace gs {
namespace {

class CpuOfRank final : public RankDevice {
 public:
  std::unique_ptr<Backend> backend(std::vector<PeerSocket> peers, PeerRules rules) override {
    return make_ranked_backend(make_peer_crew(std::move(peers), std::move(rules)));
  }
  void work(PeerSocket& leader, int rank, int count, double deadline,
            const std::vector<View>& views, const PhotometricConfig& photometric) override {
    work_as_rank(leader, rank, count, deadline, views, photometric);
  }
};

#ifdef GS_HAVE_CUDA
class GpuOfRank final : public RankDevice {
 public:
  explicit GpuOfRank(int gpu) : gpu_(gpu), links_(cuda::make_nccl_links()) {}
  std::unique_ptr<Backend> backend(std::vector<PeerSocket> peers, PeerRules rules) override {
    return cuda::make_process_backend(gpu_, std::move(peers), std::move(rules), std::move(links_));
  }
  void work(PeerSocket& leader, int rank, int count, double deadline,
            const std::vector<View>& views, const PhotometricConfig& photometric) override {
    cuda::work_as_gpu_rank(gpu_, leader, rank, count, deadline, views, photometric,
                           std::move(links_));
  }

 private:
  const int gpu_;
  std::unique_ptr<cuda::DeviceLinks> links_;
};
#endif

}  // namespace

std::unique_ptr<RankDevice> make_rank_device(
    const TrainConfig& train, [[maybe_unused]] const std::function<int(int, int)>& gpu) {
  if (is_cpu(train.device)) return std::make_unique<CpuOfRank>();
  const int first = first_gpu(train);
#ifdef GS_HAVE_CUDA
  if (const int visible = cuda_device_count(); visible > 0)
    return std::make_unique<GpuOfRank>(gpu(first, visible));
#endif
  make_backend(train.device);  // which says what is missing
  throw Error("there is no GPU cuda:" + std::to_string(first));
}

}  // namespace gs
