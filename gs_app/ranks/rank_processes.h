// SPDX-License-Identifier: Apache-2.0
// The processes of a run's other ranks: they are started, or awaited where srun or mpirun has
// started them, and met.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "gs_app/ranks/rank_place.h"
#include "gs_core/processes/peer_socket.h"
#include "gs_core/processes/process.h"

namespace gs {

/// Rank 0 has one. Sockets take only processes that know the run's nonce, 128 random bits: our own
/// children get it in their environment, which other users cannot read, and those of srun and mpirun
/// in a file that only the user can read.
class RankProcesses {
 public:
  /// Opens the port. Without `place` starts `program rank` for each of the other ranks; else it
  /// writes the meeting file. Throws Error.
  RankProcesses(int count, const std::string& program, const std::optional<RankPlace>& place);
  /// Removes the file, and waits for the processes that it has started.
  ~RankProcesses();
  RankProcesses(const RankProcesses&) = delete;
  RankProcesses& operator=(const RankProcesses&) = delete;

  /// Waits until all ranks have come, and returns their connections: rank 1, 2, ... Throws Error
  /// that names a rank which has another version of the program, has ended, or does not come.
  std::vector<PeerSocket> meet();
  /// Why the connection to a rank was lost, for a sentence that begins with its number.
  std::string why_lost(int rank);

 private:
  void start(const std::string& program);
  void write_meeting_file(const std::filesystem::path& file);
  std::optional<int> greet(PeerSocket& peer);
  void reap();
  int missing(const std::vector<std::optional<PeerSocket>>& peers) const;

  const int count_;
  const std::string nonce_;
  PeerListener listener_;
  std::filesystem::path meeting_file_;  // empty: there is none
  std::map<pid_t, int> children_;       // that run, with their ranks
  std::map<int, ProcessEnd> ended_;     // by rank
};

/// Another rank's way to rank 0: connects, and says hello. Throws Error.
PeerSocket reach_rank_0(const RankPlace& place);

}  // namespace gs
