// SPDX-License-Identifier: Apache-2.0
// A short training run of the bundled scene gives the same quality on the GPU as on the CPU.
#include "data_loaders/scene/load_scene.h"
#include "tests/support/cuda.h"

namespace gs {
namespace {

using CudaTrain = CudaTest;

struct Outcome {
  double psnr;
  std::size_t count;
};

Outcome trained(Backend& backend, const Scene& scene, const Config& config, int steps) {
  Trainer trainer(scene, config, backend);
  After stop = stop_after(steps);
  trainer.add_observer(stop);
  trainer.run();
  return {psnr_of(backend, trainer, scene.test_views), trainer.model().count()};
}

class CudaTrainCourtyard : public CudaTrain {
 protected:
  CudaTrainCourtyard() {
    config_.dataset.source = std::string(GS_SOURCE_DIR) + "/examples/courtyard";
    config_.dataset.resolution = 2;
    config_.dataset.eval = true;
  }
  Config config_ = adaptive_config();
};

// The first 500 steps of the standard schedule: no Gaussian is added yet, and the two backends stay
// close.
TEST_F(CudaTrainCourtyard, FiveHundredStepsComeOutAsOnTheCpu) {
  const Scene scene = load_scene(config_.dataset);
  const Outcome on_cpu = trained(cpu(), scene, config_, 500);
  const Outcome on_gpu = trained(gpu(), scene, config_, 500);
  RecordProperty("cpu_psnr", std::to_string(on_cpu.psnr));
  RecordProperty("gpu_psnr", std::to_string(on_gpu.psnr));
  EXPECT_NEAR(on_gpu.psnr, on_cpu.psnr, 0.1);
  EXPECT_EQ(on_gpu.count, on_cpu.count);
  EXPECT_GT(on_cpu.psnr, 15);
}

// The same on photos that are reduced four times, twice, and then whole.
TEST_F(CudaTrainCourtyard, FiveHundredStepsOnAResolutionRampComeOutAsOnTheCpu) {
  const Scene scene = load_scene(config_.dataset);
  config_.train.resolution_ramp = {4, 2};
  config_.train.resolution_every = 180;
  config_.train.resolution_least = 1;
  const Outcome on_cpu = trained(cpu(), scene, config_, 500);
  const Outcome on_gpu = trained(gpu(), scene, config_, 500);
  EXPECT_NEAR(on_gpu.psnr, on_cpu.psnr, 0.1);
  EXPECT_EQ(on_gpu.count, on_cpu.count);
  EXPECT_GT(on_cpu.psnr, 15);
}

// A whole run of 500 steps, with densification, opacity reset and Morton order. The last bits of
// sums decide which Gaussians are split, so single runs scatter, and means of five seeds are
// compared.
TEST_F(CudaTrainCourtyard, AWholeShortRunComesOutAsOnTheCpu) {
  const Scene scene = load_scene(config_.dataset);
  config_.train.iterations = 500;
  Outcome on_cpu{0, 0}, on_gpu{0, 0};
  constexpr int kSeeds = 5;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    config_.train.seed = std::uint64_t(seed);
    const Outcome c = trained(cpu(), scene, config_, 500), g = trained(gpu(), scene, config_, 500);
    on_cpu = {on_cpu.psnr + c.psnr / kSeeds, on_cpu.count + c.count};
    on_gpu = {on_gpu.psnr + g.psnr / kSeeds, on_gpu.count + g.count};
  }
  RecordProperty("cpu_psnr", std::to_string(on_cpu.psnr));
  RecordProperty("gpu_psnr", std::to_string(on_gpu.psnr));
  EXPECT_NEAR(on_gpu.psnr, on_cpu.psnr, 0.3);
  EXPECT_NEAR(double(on_gpu.count), double(on_cpu.count), 0.03 * double(on_cpu.count));
}

}  // namespace
}  // namespace gs
