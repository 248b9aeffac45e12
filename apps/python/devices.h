// SPDX-License-Identifier: Apache-2.0
// Backends for pictures, one for each device, which are kept from call to call; and the number of
// threads, which must not change during work.
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "gs_train/backend.h"

namespace gs::python {

/// A backend that only this thread uses while the object lives; other threads wait. Release the GIL
/// before making one.
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

/// While one lives, the number of threads cannot change.
class Work {
 public:
  Work() { count(1); }
  ~Work() { count(-1); }
  Work(const Work&) = delete;
  Work& operator=(const Work&) = delete;

 private:
  static void count(int change);
};

/// Sets the number of threads of all parallel loops; 0 means all cores. Throws UsageError while
/// there is Work.
void set_threads(int threads);
/// What set_threads() was called with last; 0 before.
int threads_asked_for();

}  // namespace gs::python
