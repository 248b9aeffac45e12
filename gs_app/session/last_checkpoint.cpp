// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/last_checkpoint.h"

#include <memory>
#include <utility>

#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/plain_message.h"
#include "gs_core/threads/start_threads.h"

namespace gs {
namespace {

// Null where memory is short.
std::shared_ptr<const TrainingModel> host_copy_of(const TrainingModel& model) {
  if (checkpoint_bytes(model, 0) > host_memory().free_bytes() / 2) return nullptr;
  try {
    return std::make_shared<const TrainingModel>(copy_to(host_memory(), model));
  } catch (const Error& error) {
    if (error.code() != ExitCode::out_of_memory) throw;
  } catch (const std::bad_alloc&) {
  }
  return nullptr;
}

}  // namespace

bool LastCheckpoint::save(const RunProgress& progress, const TrainingModel& model) {
  wait();
  const bool is_copied = progress.step == last_step_ && &model.memory() != &host_memory();
  std::shared_ptr<const TrainingModel> copy = is_copied ? host_copy_of(model) : nullptr;
  if (!copy) return folder_.save(progress, model);
  written_ = in_background([this, progress, copy = std::move(copy)]() mutable {
    try {
      folder_.save(progress, *copy);
    } catch (const std::exception& error) {  // memory ran out
      log_warning("no checkpoint of step {}: {}", progress.step, plain_message(error));
    }
    copy.reset();  // its pages go now, and not while the program ends
  });
  return true;
}

std::optional<TrainingState> LastCheckpoint::newest() {
  wait();
  return folder_.newest();
}

void LastCheckpoint::wait() {
  if (written_.valid()) written_.get();
}

}  // namespace gs
