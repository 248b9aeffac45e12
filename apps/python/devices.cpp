// SPDX-License-Identifier: Apache-2.0
#include "apps/python/devices.h"

#include <algorithm>
#include <map>
#include <thread>

#include "gs_app/run/make_backend.h"
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"

namespace gs::python {
namespace {

struct Device {
  std::mutex mutex;
  std::unique_ptr<Backend> backend;
};

// Never ended: at the end of the process a driver may be gone before it.
Device& device_named(const std::string& name) {
  static auto& mutex = *new std::mutex;
  static auto& devices = *new std::map<std::string, Device>;
  const std::scoped_lock lock(mutex);
  return devices[name];
}

std::mutex g_work_mutex;
int g_work = 0, g_threads = 0;

}  // namespace

BorrowedBackend::BorrowedBackend(const std::string& called) {
  const std::string name = called == "cuda" || (called == "auto" && cuda_device_count() > 0)
                               ? "cuda:0"
                           : called == "auto" ? "cpu"
                                              : called;
  Device& device = device_named(name);
  turn_ = std::unique_lock(device.mutex);
  if (!device.backend) device.backend = make_backend(name);
  backend_ = device.backend.get();
  backend_->device().make_current();
}

void Work::count(int change) {
  const std::scoped_lock lock(g_work_mutex);
  g_work += change;
}

void set_threads(int threads) {
  const std::scoped_lock lock(g_work_mutex);
  if (threads < 0) throw UsageError("the number of threads must be 0 (all cores) or more");
  const int wanted = threads > 0 ? threads : std::max(1, int(std::thread::hardware_concurrency()));
  const bool changes = wanted != thread_count();
  if (changes && g_work)
    throw UsageError("the number of threads cannot change while gemsplat trains or renders");
  g_threads = threads;
  if (changes) set_thread_count(threads);
}

int threads_asked_for() {
  const std::scoped_lock lock(g_work_mutex);
  return g_threads;
}

}  // namespace gs::python
