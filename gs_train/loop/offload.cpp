// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loop/offload.h"

#include <spdlog/fmt/fmt.h>

#include <chrono>

#include "gs_core/bytes.h"
#include "gs_core/error.h"
#include "gs_core/log.h"

namespace gs {
namespace {

constexpr std::size_t kCopyBytes = std::size_t(64) << 20;  // larger than caches
constexpr int kCopies = 4;

double seconds_now() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

double gib(double bytes) { return bytes / kBytesPerGib; }

}  // namespace

void check_offload(const Config& config, Backend& backend) {
  if (config.train.offload != OffloadMode::sh || backend.offload_memory()) return;
  throw UsageError("train.offload=sh is for a run on one GPU, and this one is on " +
                   backend.name() +
                   "; leave train.offload out, or train with --device cuda and train.ranks=1");
}

ModelMemory model_memory(OffloadMode mode, const TrainingSize& size, Backend& backend) {
  Memory* const offload = backend.offload_memory();
  if (mode == OffloadMode::none || !offload) return backend.memory();
  const FreeMemory free{double(backend.memory().free_bytes()), double(host_memory().free_bytes())};
  if (mode == OffloadMode::automatic && !needs_offload(size, free)) return backend.memory();
  return {backend.memory(), *offload};
}

ModelMemory model_memory(const Config& config, const Scene& scene, Backend& backend,
                         std::size_t start) {
  check_offload(config, backend);
  const OffloadMode mode = config.train.offload;
  const TrainingSize size = training_size(config, picture_sizes(scene.train_views),
                                          certain_gaussians(config, double(start)));
  const ModelMemory memory = model_memory(mode, size, backend);
  if (!memory.offloads_sh()) return memory;
  TrainingSize offloaded = with_offload(size);
  log_info("{}", text_of_offload(offloaded, mode == OffloadMode::automatic,
                                 backend.memory().free_bytes(), link_gb_per_second(backend)));
  return memory;
}

// Stage 1 reads SH of a row that is seen. Stage 7 reads it again; where the update is one by a single
// photo, that is the read of the update (cuda/train/preprocess_backward.cuh).
LinkBytes link_bytes(const TrainingSize& size) {
  const double sh = sizeof(ShRest),
               moments = size.moment_bytes * double(sizeof(ShRest)) / sizeof(float);
  return {size.batch > 1 ? 2 * sh : sh, sh + moments};
}

std::optional<double> link_gb_per_second(Backend& backend) {
  Memory* const offload = backend.offload_memory();
  if (!offload) return std::nullopt;
  try {
    Buffer<std::uint8_t> from(kCopyBytes, *offload), to(kCopyBytes, backend.memory());
    from.fill_zero();
    const auto seconds_of = [&](int copies) {
      const double begin = seconds_now();
      for (int i = 0; i < copies; ++i) to.memory().upload(to.data(), from.data(), kCopyBytes);
      return seconds_now() - begin;
    };
    seconds_of(1);
    return 1e-9 * kCopies * double(kCopyBytes) / seconds_of(kCopies);
  } catch (const Error& error) {
    if (error.code() != ExitCode::out_of_memory) throw;
    return std::nullopt;
  }
}

std::string text_of_offload(const TrainingSize& size, bool is_auto, std::size_t free_on_gpu,
                            const std::optional<double>& gb_per_second) {
  const LinkBytes bytes = link_bytes(size);
  std::string text = fmt::format(
      "train.offload is sh{}: SH and its moments take up to {:.1f} GiB of host memory, and the "
      "rest {:.1f} GiB of the GPU's, of which {:.1f} are free; a photo reads {:.0f} bytes of each "
      "Gaussian that it sees, and an update moves {:.0f} each way of all",
      is_auto ? ", because the run fits only so" : "", gib(offloaded_bytes(size)),
      gib(training_bytes(size)), gib(double(free_on_gpu)), bytes.by_photo, bytes.by_update);
  if (gb_per_second)
    text +=
        fmt::format("; at {:.1f} GB/s that is {:.0f} and {:.0f} ms for a million", *gb_per_second,
                    bytes.by_photo / *gb_per_second, bytes.by_update / *gb_per_second);
  return text;
}

}  // namespace gs
