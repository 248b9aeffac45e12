// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/make_backend.h"

#include <charconv>

#include "gs_core/error.h"
#include "gs_train/ranks/ranked_backend.h"

#ifdef GS_HAVE_CUDA
#include "cuda/backend.h"
#endif

namespace gs {
namespace {

#ifdef GS_HAVE_CUDA
std::unique_ptr<Backend> make_cuda_backend(int index) {
  if (index < cuda_device_count()) return cuda::make_backend(index);
  throw Error("there is no GPU cuda:" + std::to_string(index) + ": the driver reports " +
              std::to_string(cuda_device_count()) + "; check nvidia-smi, or use --device cpu");
}
#else
std::unique_ptr<Backend> make_cuda_backend(int) {
  throw Error(
      "this build has no CUDA; configure again with nvcc on the PATH (-DGS_REQUIRE_CUDA=ON says "
      "what is missing), or use --device cpu");
}
#endif

// The number N of "cuda:N"; 0 for "cuda".
int cuda_index(const std::string& device) {
  if (device == "cuda") return 0;
  constexpr std::string_view kPrefix = "cuda:";
  int index = -1;
  if (device.starts_with(kPrefix)) {
    const char* const end = device.data() + device.size();
    const auto [rest, error] = std::from_chars(device.data() + kPrefix.size(), end, index);
    if (error == std::errc::result_out_of_range)
      throw UsageError("--device " + device + ": there is no GPU with such a number");
    if (error != std::errc() || rest != end) index = -1;
  }
  if (index < 0)
    throw UsageError("there is no device " + device + "; there are cpu, cuda, cuda:N and auto");
  return index;
}

}  // namespace

#ifdef GS_HAVE_CUDA
bool has_cuda() { return true; }
int cuda_device_count() { return cuda::device_count(); }
#else
bool has_cuda() { return false; }
int cuda_device_count() { return 0; }
#endif

namespace {

bool is_cpu(const std::string& device) {
  return device == "cpu" || (device == "auto" && cuda_device_count() == 0);
}

}  // namespace

std::unique_ptr<Backend> make_backend(const std::string& device) {
  if (is_cpu(device)) return make_scalar_backend();
  return make_cuda_backend(device == "auto" ? 0 : cuda_index(device));
}

void check_has_ranks(const TrainConfig& train) {
  if (!is_cpu(train.device))
    throw UsageError("train.ranks is " + std::to_string(train.ranks) + ", and train.device is " +
                     train.device +
                     ": several ranks train on the CPU only so far; set train.ranks=1, or train "
                     "with --device cpu");
}

std::unique_ptr<Backend> make_training_backend(const TrainConfig& train) {
  if (train.ranks == 1) return make_backend(train.device);
  check_has_ranks(train);
  return make_ranked_backend({train.ranks, double(train.rank_deadline)});
}

}  // namespace gs
