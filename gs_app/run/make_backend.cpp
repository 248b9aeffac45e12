// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/make_backend.h"

#include <algorithm>
#include <charconv>
#include <vector>

#include "gs_core/error.h"

#ifdef GS_HAVE_CUDA
#include "cuda/backend.h"
#endif

namespace gs {
namespace {

namespace fs = std::filesystem;

#ifdef GS_HAVE_CUDA
// The backend of `count` GPUs from `first` on.
std::unique_ptr<Backend> make_cuda_backend(int first, int count,
                                           const ProcessPlace* place = nullptr,
                                           const fs::path& output = {}) {
  const int visible = cuda_device_count();
  if (visible == 0) throw Error(why_no_gpu() + ", or use --device cpu");
  if (place) first = first_gpu_of(*place, first, count, visible);
  if (first >= visible)
    throw Error("there is no GPU cuda:" + std::to_string(first) + ": the driver reports " +
                std::to_string(visible) + "; check nvidia-smi, or use --device cpu");
  if (count > visible - first)
    throw UsageError("train.ranks is " + std::to_string(count) +
                     ", and from cuda:" + std::to_string(first) + " on there are only " +
                     std::to_string(visible - first) +
                     " GPUs; set train.ranks=" + std::to_string(visible - first));
  std::vector<int> devices;
  for (int i = 0; i < count; ++i) devices.push_back(first + i);
  if (!place) return cuda::make_backend(devices);
  const std::string folder = output.string();
  return cuda::make_backend(
      devices, cuda::kChunkRows,
      {place->rank, place->count, folder + ".processes-" + place->job,
       "; if there is a checkpoint in " + folder + "/checkpoints, --resume " + folder +
           " goes on from it, with any number of processes and GPUs"});
}
#else
std::unique_ptr<Backend> make_cuda_backend(int, int, const ProcessPlace* = nullptr,
                                           const fs::path& = {}) {
  throw Error(
      "this build has no CUDA; configure again with nvcc on the PATH (-DGS_REQUIRE_CUDA=ON says "
      "what is missing), or use --device cpu");
}
#endif

// The number N of "cuda:N"; 0 for "cuda", and for "auto" where there is a GPU.
int cuda_index(const std::string& device) {
  if (device == "cuda" || device == "auto") return 0;
  if (const std::optional<int> number = gpu_number(device)) return *number;
  throw UsageError("there is no device " + device + "; there are cpu, cuda, cuda:N and auto");
}

}  // namespace

#ifdef GS_HAVE_CUDA
bool has_cuda() { return true; }
int cuda_device_count() { return cuda::device_count(); }
std::string why_no_gpu() { return cuda::why_no_gpu(); }
const SplatOperator& gpu_operator() { return cuda::splat_operator(); }
#else
bool has_cuda() { return false; }
int cuda_device_count() { return 0; }
std::string why_no_gpu() {
  return "training and rendering run on the CPU; build again where nvcc is on the PATH";
}
const SplatOperator& gpu_operator() {
  throw UsageError(
      "this gemsplat was built without CUDA; build again where nvcc is on the PATH, or give arrays "
      "on the CPU");
}
#endif

bool is_cpu(const std::string& device) {
  return device == "cpu" || (device == "auto" && cuda_device_count() == 0);
}

std::optional<int> gpu_number(const std::string& device) {
  constexpr std::string_view kPrefix = "cuda:";
  if (!device.starts_with(kPrefix)) return std::nullopt;
  int number = -1;
  const char* const end = device.data() + device.size();
  const auto [rest, error] = std::from_chars(device.data() + kPrefix.size(), end, number);
  if (error == std::errc::result_out_of_range)
    throw UsageError("--device " + device + ": there is no GPU with such a number");
  if (error != std::errc() || rest != end || number < 0) return std::nullopt;
  return number;
}

std::unique_ptr<Backend> make_backend(const std::string& device) {
  if (is_cpu(device)) return make_scalar_backend();
  return make_cuda_backend(cuda_index(device), 1);
}

void take_gpus(const std::string& gpus, bool is_new, TrainConfig& train) {
  if (train.device == "cpu")
    throw UsageError(
        "--gpus is for training on GPUs, and the device is cpu; leave one of them out");
  if (train.device == "auto") train.device = "cuda";
  int count = 0;
  const char* const end = gpus.data() + gpus.size();
  const auto [rest, error] = std::from_chars(gpus.data(), end, count);
  if (gpus == "all")
    count = std::max(cuda_device_count() - cuda_index(train.device), 1);
  else if (error != std::errc() || rest != end || count < 1 || count > kMostBatch)
    throw UsageError("--gpus " + gpus + ": give a number from 1 to " + std::to_string(kMostBatch) +
                     ", or all");
  train.ranks = count;
  if (is_new && train.batch == 1) train.batch = std::min(count, kMostBatch);
}

std::unique_ptr<Backend> make_training_backend(const TrainConfig& train, const ProcessPlace* place,
                                               const fs::path& output) {
  if (!is_cpu(train.device))
    return make_cuda_backend(cuda_index(train.device), train.ranks, place, output);
  if (place)
    throw UsageError(
        "several processes train on GPUs only, and this run is on the CPU; start one process");
  if (train.ranks > 1)
    throw UsageError("train.ranks is " + std::to_string(train.ranks) +
                     ", which counts GPUs, and this run is on the CPU; set train.ranks=1");
  return make_scalar_backend();
}

}  // namespace gs
