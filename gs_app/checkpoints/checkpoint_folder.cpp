// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checkpoints/checkpoint_folder.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <limits>

#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPrefix = "step_", kEnding = ".ckpt";
constexpr std::size_t kKept = 2;
// Left free beside a checkpoint, for the names of views, metrics and logs: as much again as a small
// one takes, with something for its settings.
constexpr std::uint64_t kMostSpareBytes = std::uint64_t(16) << 20,
                        kLeastSpareBytes = std::uint64_t(128) << 10;

// The step in a checkpoint's name; -1 for other names.
int step_of(const std::string& name) {
  if (!name.starts_with(kPrefix) || !name.ends_with(kEnding)) return -1;
  int step = -1;
  const char* const last = name.data() + name.size() - kEnding.size();
  const auto [end, failure] = std::from_chars(name.data() + kPrefix.size(), last, step);
  return failure == std::errc() && end == last && step >= 0 ? step : -1;
}

std::uint64_t with_spare(std::uint64_t bytes) {
  return bytes + std::min(kMostSpareBytes, kLeastSpareBytes + bytes);
}

}  // namespace

std::vector<CheckpointPath> checkpoints_in(const fs::path& folder) {
  std::vector<CheckpointPath> found;
  for (const fs::path& file : entries_of(folder)) {
    const int step = step_of(file.filename().string());
    if (step >= 0) found.push_back({step, file});
  }
  std::sort(found.begin(), found.end(),
            [](const CheckpointPath& a, const CheckpointPath& b) { return a.step > b.step; });
  return found;
}

std::optional<Checkpoint> newest_checkpoint(const fs::path& folder, CheckpointPart part) {
  for (const CheckpointPath& candidate : checkpoints_in(folder)) {
    try {
      return read_checkpoint(candidate.file, part);
    } catch (const AccessError&) {
      throw;
    } catch (const Error& error) {
      if (error.code() == ExitCode::out_of_memory) throw;
      if (part == CheckpointPart::head) continue;
      log_warning("{}; it is renamed to {}.refused, and the older checkpoint is used", error.what(),
                  candidate.file.filename().string());
    }
    std::error_code ignored;
    fs::rename(candidate.file, candidate.file.string() + ".refused", ignored);
  }
  return std::nullopt;
}

std::uint64_t free_space(const fs::path& folder) {
  std::error_code error;
  const fs::space_info space = fs::space(folder, error);
  return error ? std::numeric_limits<std::uint64_t>::max() : space.available;
}

CheckpointFolder::CheckpointFolder(fs::path folder, const Config& config, SceneRecord scene,
                                   FreeSpace space)
    : folder_(std::move(folder)), config_(config), scene_(std::move(scene)),
      space_(std::move(space)) {}

fs::path CheckpointFolder::file_of(int step) const {
  return folder_ / fmt::format("{}{}{}", kPrefix, step, kEnding);
}

bool CheckpointFolder::save(const RunProgress& progress, const TrainingModel& model) {
  try {
    std::error_code ignored;
    fs::create_directories(folder_, ignored);  // if it fails, write_checkpoint() says so
    if (!has_space(with_spare(checkpoint_bytes(model, scene_.views.size())), progress.step))
      return false;
    write_checkpoint(file_of(progress.step), config_, scene_, progress, model);
  } catch (const Error& error) {
    if (error.code() == ExitCode::out_of_memory) throw;
    log_warning("no checkpoint of step {}: {}; training goes on", progress.step, error.what());
    return false;
  }
  remove_all_but(kKept);
  return true;
}

// Removes the older of two checkpoints if that frees enough space. The last one is never removed.
bool CheckpointFolder::has_space(std::uint64_t bytes, int step) {
  if (space_(folder_) < bytes) remove_all_but(1);
  const std::uint64_t space = space_(folder_);
  if (space >= bytes) return true;
  log_warning(
      "no checkpoint of step {}: it needs {:.1f} MB, and {:.1f} MB are free on the disk of {}; "
      "free some space; training goes on",
      step, double(bytes) / 1e6, double(space) / 1e6, folder_.string());
  return false;
}

std::optional<TrainingState> CheckpointFolder::newest() {
  std::optional<Checkpoint> found = newest_checkpoint(folder_);
  if (!found) return std::nullopt;
  return std::move(found->state);
}

// If the folder cannot be listed now, a later call removes them.
void CheckpointFolder::remove_all_but(std::size_t count) try {
  const std::vector<CheckpointPath> found = checkpoints_in(folder_);
  std::error_code ignored;
  for (std::size_t i = count; i < found.size(); ++i) fs::remove(found[i].file, ignored);
} catch (const AccessError& error) {
  log_warning("older checkpoints may stay: {}", error.what());
}

}  // namespace gs
