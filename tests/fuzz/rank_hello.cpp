// SPDX-License-Identifier: Apache-2.0
// The first bytes of a stranger at the port of a run's ranks.
#include <sys/socket.h>

#include "gs_app/ranks/shared_scene.h"
#include "gs_core/processes/peer_socket.h"
#include "gs_train/ranks/peer_ranks.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

constexpr std::uint64_t kMost = 4096;  // bytes, as gs_app/ranks has it
constexpr PeerSocket::Seconds kPatience{1};

void read(std::string_view bytes) {
  int ends[2];
  require(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends) == 0, "no sockets are left");
  PeerSocket run{Descriptor(ends[0])};
  {
    const Descriptor stranger(ends[1]);
    require(::send(stranger, bytes.data(), bytes.size(), 0) == ssize_t(bytes.size()),
            "a socket does not take its input");
  }
  try {
    const Frame frame = run.receive(kPatience, kMost);
    require(frame.bytes.size() <= kMost, "a frame is too long");
    takes([&] {
      const RankHello hello = hello_in(frame.bytes);
      require(hello_in(message_of(hello)).nonce == hello.nonce, "a greeting does not read back");
    });
  } catch (const PeerLost&) {
  }
}

const Registered registered{"rank_hello", read};

}  // namespace
}  // namespace gs::fuzz
