// SPDX-License-Identifier: Apache-2.0
#include "gs_app/ranks/rank_processes.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <fstream>
#include <random>
#include <thread>

#include "gs_app/ranks/shared_scene.h"
#include "gs_core/error.h"
#include "gs_core/host_name.h"
#include "gs_core/log.h"
#include "gs_core/version.h"
#include "gs_train/ranks/peer_ranks.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Seconds = PeerSocket::Seconds;

constexpr Seconds kMeetingTime{120};  // until all ranks have come
constexpr Seconds kGreetingTime{10};  // for the first message of one that has connected
constexpr Seconds kEndTime{5};        // for a process to end by itself
constexpr Seconds kALittle{0.1};
constexpr std::uint64_t kMostOfHello = 4096;  // bytes; whoever sends more is no rank

// 128 random bits in hexadecimal.
std::string new_nonce() {
  std::random_device random;  // the system's own source
  std::string nonce;
  for (int i = 0; i < 4; ++i) nonce += fmt::format("{:08x}", random());
  return nonce;
}

std::string text_of(const ProcessEnd& end) {
  if (end.signal != 0)
    return fmt::format("its process was ended by signal {} ({})", end.signal,
                       ::strsignal(end.signal));
  return fmt::format("its process has ended with exit code {}", end.exit_code);
}

}  // namespace

RankProcesses::RankProcesses(int count, const std::string& program,
                             const std::optional<RankPlace>& place)
    : count_(count), nonce_(new_nonce()),
      listener_(place ? PeerListener::Reach::all : PeerListener::Reach::own_machine) {
  if (place)
    write_meeting_file(place->meeting_file);
  else
    start(program);
}

RankProcesses::~RankProcesses() {
  std::error_code ignored;
  if (!meeting_file_.empty()) fs::remove(meeting_file_, ignored);
  const auto end = Clock::now() + kEndTime;
  while (!children_.empty() && Clock::now() < end) {
    reap();
    if (!children_.empty()) std::this_thread::sleep_for(kALittle);
  }
  for (const auto& [process, rank] : children_) {
    ::kill(-process, SIGKILL);  // its group
    wait_for_child(process);
  }
}

void RankProcesses::start(const std::string& program) {
  for (int rank = 1; rank < count_; ++rank) {
    ChildOptions options;
    options.output = STDERR_FILENO;
    options.variables = {fmt::format("GS_RANK={}", rank), fmt::format("GS_RANKS={}", count_),
                         fmt::format("GS_RANK_PORT={}", listener_.port()),
                         "GS_RANK_NONCE=" + nonce_};
    children_[start_child({program, "rank"}, options)] = rank;
  }
}

// Written beside its place and renamed, so that nobody reads half of it.
void RankProcesses::write_meeting_file(const fs::path& file) {
  const fs::path part = file.string() + ".part";
  const std::string name = host_name(), host = name.empty() ? "localhost" : name;
  const std::string text = fmt::format("{} {} {}\n", host, listener_.port(), nonce_);
  ::unlink(part.c_str());
  const Descriptor to(::open(part.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (to < 0 || ::write(to, text.data(), text.size()) != ssize_t(text.size()))
    throw Error(
        fmt::format("cannot write {}, where the ranks of this run meet: {}; start them in "
                    "a folder that you may change",
                    part.string(), std::strerror(errno)));
  fs::rename(part, file);
  meeting_file_ = file;
}

std::vector<PeerSocket> RankProcesses::meet() {
  std::vector<std::optional<PeerSocket>> peers(std::size_t(count_ - 1));
  const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(kMeetingTime);
  while (const int rank = missing(peers)) {
    if (ended_.count(rank))
      throw Error(
          fmt::format("rank {}: {} before it came to rank 0", rank, text_of(ended_.at(rank))));
    if (Clock::now() > end)
      throw Error(
          fmt::format("rank {} has not come to rank 0 within {:g} s; check that all ranks "
                      "are started in the same folder, and that the machines reach each "
                      "other",
                      rank, kMeetingTime.count()));
    std::optional<PeerSocket> peer = listener_.accept(kALittle);
    if (peer) {
      if (const auto greeted = greet(*peer)) {
        std::optional<PeerSocket>& place = peers[std::size_t(*greeted - 1)];
        if (place) throw Error(fmt::format("two processes say that they are rank {}", *greeted));
        place.emplace(std::move(*peer));
      }
    }
    reap();
  }
  std::vector<PeerSocket> all;
  for (std::optional<PeerSocket>& peer : peers) all.push_back(std::move(*peer));
  return all;
}

// The rank of a process that has connected; nothing where it is none of this run.
std::optional<int> RankProcesses::greet(PeerSocket& peer) {
  RankHello hello;
  try {
    const Frame frame = peer.receive(kGreetingTime, kMostOfHello);
    if (RankFrame(frame.kind) != RankFrame::hello) return std::nullopt;
    hello = hello_in(frame.bytes);
  } catch (const PeerLost&) {
    return std::nullopt;
  } catch (const Error&) {
    return std::nullopt;
  }
  if (hello.nonce != nonce_ || hello.rank < 1 || hello.rank >= count_) {
    log_warning("a process that is no rank of this run has connected to its port {}",
                listener_.port());
    return std::nullopt;
  }
  if (hello.version != kVersion)
    throw Error(
        fmt::format("rank {} is gemsplat {}, and rank 0 is {}; install the same version "
                    "for all",
                    hello.rank, hello.version, kVersion));
  return hello.rank;
}

// The first rank that has not come; 0: all have.
int RankProcesses::missing(const std::vector<std::optional<PeerSocket>>& peers) const {
  for (std::size_t i = 0; i < peers.size(); ++i)
    if (!peers[i]) return int(i) + 1;
  return 0;
}

void RankProcesses::reap() {
  while (!children_.empty()) {
    const std::optional<ChildEnd> ended = ended_child();
    if (!ended) return;
    const auto child = children_.find(ended->process);
    if (child == children_.end()) continue;
    ended_[child->second] = ended->end;
    children_.erase(child);
  }
}

std::string RankProcesses::why_lost(int rank) {
  // The end of a connection is seen a little before that of its process.
  for (const auto end = Clock::now() + std::chrono::seconds(2); Clock::now() < end;) {
    reap();
    if (ended_.count(rank)) return text_of(ended_.at(rank));
    if (!meeting_file_.empty()) break;  // it is no child of ours
    std::this_thread::sleep_for(kALittle);
  }
  return "its connection was closed";
}

PeerSocket reach_rank_0(const RankPlace& place) {
  std::string host = "127.0.0.1", nonce = place.nonce;
  int port = place.port;
  const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(kMeetingTime);
  while (!place.is_ours && port == 0) {
    std::ifstream file(place.meeting_file);
    if (file >> host >> port >> nonce) break;
    port = 0;
    if (Clock::now() > end)
      throw Error(
          fmt::format("rank {}: rank 0 has not written {} within {:g} s; start all ranks "
                      "in the same folder, on a disk that they share",
                      place.rank, fs::absolute(place.meeting_file).string(), kMeetingTime.count()));
    std::this_thread::sleep_for(kALittle);
  }
  PeerSocket socket = connect_to_peer(host, port, kMeetingTime);
  socket.send(std::uint32_t(RankFrame::hello), message_of(RankHello{nonce, kVersion, place.rank}),
              kGreetingTime);
  return socket;
}

}  // namespace gs
