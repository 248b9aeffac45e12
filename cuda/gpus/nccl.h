// SPDX-License-Identifier: Apache-2.0
// The functions of NCCL that we use, found in a library that is loaded at run time. Nothing of
// gemsplat links to NCCL: it is large, lies elsewhere on each machine, and one GPU needs none.
#pragma once

#include <cstddef>

struct CUstream_st;

namespace gs::cuda {

/// As in NCCL's documentation (user guide, "NCCL API").
struct NcclId {
  char internal[128];
};
struct NcclCommunicator;  // opaque
inline constexpr int kNcclSuccess = 0, kNcclInProgress = 7;
inline constexpr int kNcclInt8 = 0;  // a data type

struct Nccl {
  int (*get_unique_id)(NcclId* id);
  int (*comm_init_rank)(NcclCommunicator** communicator, int count, NcclId id, int rank);
  int (*comm_destroy)(NcclCommunicator* communicator);
  int (*comm_get_async_error)(NcclCommunicator* communicator, int* error);
  int (*group_start)();
  int (*group_end)();
  int (*broadcast)(const void* from, void* to, std::size_t count, int type, int root,
                   NcclCommunicator* communicator, CUstream_st* stream);
  const char* (*get_error_string)(int result);
  const char* (*get_last_error)(NcclCommunicator* communicator);  // null: NCCL is older than 2.13

  /// Throws Error where a call was no success.
  void check(int result, const char* what) const;
};

/// Loads NCCL from the file that the environment variable GEMSPLAT_NCCL names, or libnccl.so.2 from
/// where the system looks for libraries. Throws UsageError that says what is missing and how to get
/// it. What was loaded stays so.
Nccl load_nccl();

}  // namespace gs::cuda
