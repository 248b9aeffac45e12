// SPDX-License-Identifier: Apache-2.0
// Backends for pictures, one for each device, kept from call to call; and who may change the number of threads when.
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "gs_train/backend.h"

namespace gs::python {

/// A backend that is ours alone while this lives; threads take turns. Made without the GIL, which it may wait long for.
class BorrowedBackend {
 public:
  /// Throws Error as make_backend() does.
  explicit BorrowedBackend(const std::string& device);
  Backend& operator*() const { return *backend_; }
  Backend* operator->() const { return backend_; }

 private:
  std::unique_lock<std::mutex> turn_;
  Backend* backend_ = nullptr;
};

/// While one lives, the number of threads stays as it is.
class Work {
 public:
  Work();
  ~Work();
  Work(const Work&) = delete;
  Work& operator=(const Work&) = delete;
};

/// For all parallel loops; 0 means all cores. Throws UsageError while there is Work.
void set_threads(int threads);

}  // namespace gs::python
