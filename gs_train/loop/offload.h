// SPDX-License-Identifier: Apache-2.0
// Whether a run keeps SH in host memory (train.offload), and what that costs: docs/offload.md.
#pragma once

#include <optional>
#include <string>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_core/training_memory.h"
#include "gs_train/backend.h"

namespace gs {

/// Throws UsageError where train.offload = "sh" does not go with the backend.
void check_offload(const Config& config, Backend& backend);

/// Where the arrays of a run lie that has so much to hold: as train.offload says, with "auto" by
/// needs_offload(). On a backend without offload memory, which check_offload() refuses for "sh",
/// all are in its own.
ModelMemory model_memory(OffloadMode mode, const TrainingSize& size, Backend& backend);
/// The same for a run that starts with so many Gaussians and has taken no memory yet. Logs what is
/// in host memory and what that costs, where it is. Throws UsageError as check_offload() does.
ModelMemory model_memory(const Config& config, const Scene& scene, Backend& backend,
                         std::size_t start);

/// Bytes of a row of sh_rest and its moments that go over the link.
struct LinkBytes {
  double by_photo = 0;   // to the GPU, for each photo that sees the row
  double by_update = 0;  // each way, for an update of the row
};
/// By the stages of cuda/ in a run as `size` says. Where no update is left for later, photos need
/// no moments; but an update is one of all rows, seen or not.
LinkBytes link_bytes(const TrainingSize& size);

/// Bandwidth from the backend's offload memory to the device, by a copy of 64 MiB, in 1e9 bytes per
/// second. Nothing where there is no such memory, or too little.
std::optional<double> link_gb_per_second(Backend& backend);

/// The log's line about a run whose SH is in host memory. `is_auto` if it is there by
/// needs_offload(). `gb_per_second` is that of the link.
std::string text_of_offload(const TrainingSize& size, bool is_auto, std::size_t free_on_gpu,
                            const std::optional<double>& gb_per_second);

}  // namespace gs
