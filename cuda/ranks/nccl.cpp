// SPDX-License-Identifier: Apache-2.0
#include "cuda/ranks/nccl.h"

#include <dlfcn.h>

#include <cstdlib>

#include "gs_core/error.h"

namespace gs::cuda {
namespace {

[[noreturn]] void refuse(const std::string& why) {
  throw UsageError(
      "GPUs of several processes (train.rank_processes, srun, mpirun) need NCCL: " + why +
      "; install it (Debian and Ubuntu: libnccl2), or name its file with the "
      "environment variable GEMSPLAT_NCCL (PyTorch brings "
      "site-packages/nvidia/nccl/lib/libnccl.so.2), or let one process drive the GPUs "
      "of one machine (--gpus N alone)");
}

template <class Function>
void find(void* library, const std::string& file, const char* name, Function& function) {
  function = reinterpret_cast<Function>(::dlsym(library, name));
  if (!function) refuse(file + " has no function " + name);
}

}  // namespace

std::string Nccl::version() const {
  int number = 0;
  get_version(&number);
  return nccl_version_text(number);
}

std::string nccl_version_text(int version) {
  const int large = version >= 10000 ? 10000 : 1000;  // until 2.8 it was 2 * 1000 + 8 * 100 + ...
  return std::to_string(version / large) + "." + std::to_string(version % large / 100) + "." +
         std::to_string(version % 100);
}

Nccl load_nccl(const std::string& file) {
  // We use none of the reductions that NVLink multicast (NVLS) is for, and some machines do not
  // allow it.
  ::setenv("NCCL_NVLS_ENABLE", "0", 1);
  void* const library = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!library) {
    const char* const reason = ::dlerror();
    refuse(reason ? reason : file + " cannot be loaded");
  }
  Nccl nccl{};
  find(library, file, "ncclGetVersion", nccl.get_version);
  find(library, file, "ncclGetUniqueId", nccl.get_unique_id);
  find(library, file, "ncclCommInitRank", nccl.comm_init_rank);
  find(library, file, "ncclCommDestroy", nccl.comm_destroy);
  find(library, file, "ncclCommAbort", nccl.comm_abort);
  find(library, file, "ncclCommGetAsyncError", nccl.comm_get_async_error);
  find(library, file, "ncclGroupStart", nccl.group_start);
  find(library, file, "ncclGroupEnd", nccl.group_end);
  find(library, file, "ncclSend", nccl.send);
  find(library, file, "ncclRecv", nccl.recv);
  find(library, file, "ncclGetErrorString", nccl.get_error_string);
  nccl.get_last_error =
      reinterpret_cast<decltype(nccl.get_last_error)>(::dlsym(library, "ncclGetLastError"));
  return nccl;
}

}  // namespace gs::cuda
