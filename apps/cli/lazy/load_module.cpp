// SPDX-License-Identifier: Apache-2.0
#include <dlfcn.h>

#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

#include "apps/cli/lazy/modules.h"
#include "gs_core/error.h"

namespace gs {
namespace {

constexpr int kThreadsOfLibraries = 8;  // log4cplus, below OpenImageIO 2.4, starts three

// Some libraries start threads while they are loaded, and end the whole program where the system
// refuses them.
void check_threads(const std::filesystem::path& module) {
  std::mutex until_all_run;
  std::vector<std::thread> threads;
  threads.reserve(kThreadsOfLibraries);
  std::error_code refused;
  {
    const std::lock_guard none_ends_yet(until_all_run);
    try {
      while (threads.size() < kThreadsOfLibraries)
        threads.emplace_back([&] { const std::lock_guard end(until_all_run); });
    } catch (const std::system_error& error) {
      refused = error.code();
    }
  }
  for (std::thread& thread : threads) thread.join();
  if (refused)
    throw Error("cannot load " + module.string() + ": the system refuses threads (" +
                refused.message() + "); close other programs, or raise the limits (ulimit -u)");
}

}  // namespace

const void* load_module(const std::string& file, const std::string& symbol) {
  namespace fs = std::filesystem;
  const fs::path program = fs::read_symlink("/proc/self/exe");
  const fs::path module = program.parent_path().parent_path() / "lib" / "gemsplat" / file;
  check_threads(module);
  void* const handle = dlopen(module.c_str(), RTLD_NOW | RTLD_LOCAL);
  const void* const table = handle ? dlsym(handle, symbol.c_str()) : nullptr;
  if (!table)
    throw Error("cannot load " + module.string() + ": " + std::string(dlerror()) +
                "; keep the folders bin and lib of gemsplat together, or install it again");
  return table;
}

}  // namespace gs
