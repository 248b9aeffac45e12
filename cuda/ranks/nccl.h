// SPDX-License-Identifier: Apache-2.0
// The functions of NCCL that links use, found in a library that is loaded at run time. Nothing of
// gemsplat links to NCCL: it is large, lies elsewhere on each machine, and one GPU needs none.
#pragma once

#include <cstddef>
#include <string>

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
  int (*get_version)(int* version);
  int (*get_unique_id)(NcclId* id);
  int (*comm_init_rank)(NcclCommunicator** communicator, int count, NcclId id, int rank);
  int (*comm_destroy)(NcclCommunicator* communicator);
  int (*comm_abort)(NcclCommunicator* communicator);
  int (*comm_get_async_error)(NcclCommunicator* communicator, int* error);
  int (*group_start)();
  int (*group_end)();
  int (*send)(const void* from, std::size_t count, int type, int rank,
              NcclCommunicator* communicator, CUstream_st* stream);
  int (*recv)(void* to, std::size_t count, int type, int rank, NcclCommunicator* communicator,
              CUstream_st* stream);
  const char* (*get_error_string)(int result);
  const char* (*get_last_error)(NcclCommunicator* communicator);  // null: NCCL is older than 2.13

  std::string version() const;  // "2.28.9"
};

/// Loads NCCL from a file, or, by its name, from where the system looks for libraries. Throws
/// UsageError that says what is missing and how to get it. What was loaded stays so.
Nccl load_nccl(const std::string& file);

/// From the number that NCCL gives to the words of its releases.
std::string nccl_version_text(int version);

}  // namespace gs::cuda
