// SPDX-License-Identifier: Apache-2.0
#include "cuda/gpus/nccl.h"

#include <dlfcn.h>

#include <cstdlib>
#include <string>

#include "gs_core/error.h"

namespace gs::cuda {
namespace {

[[noreturn]] void refuse(const std::string& why) {
  throw UsageError(
      "GPUs of several processes (srun, mpirun) need NCCL: " + why +
      "; install it (Debian and Ubuntu: libnccl2), or name its file with the environment variable "
      "GEMSPLAT_NCCL (PyTorch brings site-packages/nvidia/nccl/lib/libnccl.so.2), or let one "
      "process "
      "drive the GPUs of one machine (--gpus N)");
}

template <class Function>
void find(void* library, const std::string& file, const char* name, Function& function) {
  function = reinterpret_cast<Function>(::dlsym(library, name));
  if (!function) refuse(file + " has no function " + name);
}

}  // namespace

void Nccl::check(int result, const char* what) const {
  if (result == kNcclSuccess || result == kNcclInProgress) return;
  std::string why = get_error_string(result);
  if (get_last_error)
    if (const char* const last = get_last_error(nullptr); last && *last)
      why += std::string(" (") + last + ")";
  throw Error(std::string("NCCL failed in ") + what + ": " + why +
              "; set NCCL_DEBUG=WARN to see more");
}

Nccl load_nccl() {
  const char* const named = std::getenv("GEMSPLAT_NCCL");
  const std::string file = named && *named ? named : "libnccl.so.2";
  // We use none of the reductions that NVLink multicast (NVLS) is for, and some machines do not
  // allow it.
  ::setenv("NCCL_NVLS_ENABLE", "0", 1);
  void* const library = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!library) {
    const char* const reason = ::dlerror();
    refuse(reason ? reason : file + " cannot be loaded");
  }
  Nccl nccl{};
  find(library, file, "ncclGetUniqueId", nccl.get_unique_id);
  find(library, file, "ncclCommInitRank", nccl.comm_init_rank);
  find(library, file, "ncclCommDestroy", nccl.comm_destroy);
  find(library, file, "ncclCommGetAsyncError", nccl.comm_get_async_error);
  find(library, file, "ncclGroupStart", nccl.group_start);
  find(library, file, "ncclGroupEnd", nccl.group_end);
  find(library, file, "ncclBroadcast", nccl.broadcast);
  find(library, file, "ncclGetErrorString", nccl.get_error_string);
  nccl.get_last_error =
      reinterpret_cast<decltype(nccl.get_last_error)>(::dlsym(library, "ncclGetLastError"));
  return nccl;
}

}  // namespace gs::cuda
