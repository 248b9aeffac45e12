// SPDX-License-Identifier: Apache-2.0
#include "cuda/device/no_gpu.h"

namespace gs::cuda {
namespace {

std::string version_text(int version) {
  return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

}  // namespace

std::string text_of(const NoGpu& no_gpu) {
  if (no_gpu.driver_version == 0)
    return "this machine has no NVIDIA driver, or it is not loaded; install the driver, and see "
           "that nvidia-smi lists the GPU";
  if (no_gpu.is_old)
    return "the NVIDIA driver is too old: it knows CUDA up to " +
           version_text(no_gpu.driver_version) + ", and this build of gemsplat needs " +
           version_text(no_gpu.runtime_version) + "; install a newer driver";
  return "the driver reports no GPU; check nvidia-smi, and CUDA_VISIBLE_DEVICES if it is set";
}

}  // namespace gs::cuda
