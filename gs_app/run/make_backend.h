// SPDX-License-Identifier: Apache-2.0
// From the name of a device to its backend.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "gs_app/run/process_place.h"
#include "gs_core/config/config.h"
#include "gs_render/operator.h"
#include "gs_train/backend.h"

namespace gs {

/// The backend for "cpu", "cuda", "cuda:N" or "auto". "auto" is a GPU if this build and the machine
/// have one, and the CPU otherwise. Throws Error that says what is missing and how to get it, and
/// UsageError for any other name. Only one thread at a time may use a backend.
std::unique_ptr<Backend> make_backend(const std::string& device);

/// The backend for a run: make_backend(train.device), or that of several GPUs (train.ranks) from
/// train.device on. Throws UsageError where there are fewer. `place`: this is one of several processes
/// that train on GPUs and meet beside the run's folder `output`; waits for the others.
std::unique_ptr<Backend> make_training_backend(const TrainConfig& train,
                                               const ProcessPlace* place = nullptr,
                                               const std::filesystem::path& output = {});

/// Drawing and its gradient on arrays of others, on a GPU. Throws Error where this build has no CUDA.
const SplatOperator& gpu_operator();

/// Whether a device, as make_backend() takes it, is the CPU.
bool is_cpu(const std::string& device);

/// Settings of a run on `gpus` GPUs, a number or "all", from train.device on. Where the run is new
/// and says nothing else, an update takes as many photos. Throws UsageError for other words, and
/// for a run on the CPU.
void take_gpus(const std::string& gpus, bool is_new, TrainConfig& train);

/// N of the device "cuda:N"; none of any other word. Throws UsageError where N is no int.
std::optional<int> gpu_number(const std::string& device);

/// Whether this build has CUDA, and how many GPUs the driver then reports.
bool has_cuda();
int cuda_device_count();

/// Where there are no GPUs, or this build has no CUDA: what is missing, and what to do about it.
std::string why_no_gpu();

}  // namespace gs
