// SPDX-License-Identifier: Apache-2.0
// From the name of a device to its backend.
#pragma once

#include <memory>
#include <string>

#include "gs_train/backend.h"

namespace gs {

/// The backend for "cpu", "cuda", "cuda:N" or "auto". "auto" is a GPU if this build and the machine
/// have one, and the CPU otherwise. Throws Error that says what is missing and how to get it, and
/// UsageError for any other name. Only one thread at a time may use a backend.
std::unique_ptr<Backend> make_backend(const std::string& device);

/// The backend for a run: make_backend(train.device), or on the CPU several ranks (train.ranks).
/// Throws UsageError for several ranks elsewhere.
std::unique_ptr<Backend> make_training_backend(const TrainConfig& train);

/// Throws UsageError where the device of a run has no ranks.
void check_has_ranks(const TrainConfig& train);

/// Whether this build has CUDA, and how many GPUs the driver then reports.
bool has_cuda();
int cuda_device_count();

}  // namespace gs
