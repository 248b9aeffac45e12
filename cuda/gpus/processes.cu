// SPDX-License-Identifier: Apache-2.0
#include "cuda/gpus/processes.cuh"

#include <fcntl.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>

namespace gs::cuda {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kMeetingTime{25};  // until all processes have come
constexpr std::chrono::milliseconds kBetweenLooks{100};

// No thread of a process that waits for a lost one can be trusted to come back. Nothing is lost:
// files are complete or absent, and a checkpoint is kept.
[[noreturn]] void end_process(const std::string& why) {
  std::fprintf(stderr, "error: %s\n", why.c_str());
  std::fflush(stderr);
  ::_exit(int(ExitCode::bad_data));
}

// Written beside its place and renamed, so that nobody reads half of it. It lets others join, so
// that only the user can read it.
void write_ids(const fs::path& file, const std::vector<NcclId>& ids) {
  const fs::path part = file.string() + ".part";
  ::unlink(part.c_str());
  const int to = ::open(part.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  const auto bytes = ssize_t(ids.size() * sizeof(NcclId));
  const bool is_written = to >= 0 && ::write(to, ids.data(), std::size_t(bytes)) == bytes;
  if (to >= 0) ::close(to);
  if (!is_written)
    throw Error("cannot write " + part.string() +
                ", where the processes of this run meet; name another output (-o)");
  fs::rename(part, file);
}

}  // namespace

Processes::Processes(const Process& process, Gpus& gpus)
    : process_(process), gpus_(gpus), nccl_(load_nccl()), communicators_(gpus.count()),
      watch_([this] { watch(); }) {
  try {
    connect();
  } catch (...) {
    end_watch();
    throw;
  }
}

// Where this process fails, the others may wait for it, and NCCL is left alone.
Processes::~Processes() {
  end_watch();
  if (std::uncaught_exceptions() > 0) return;
  for (NcclCommunicator* const communicator : communicators_) nccl_.comm_destroy(communicator);
}

// NCCL connects processes when they first share something: they do so now, so that later a process
// that is gone is noticed at once.
void Processes::connect() {
  const std::vector<NcclId> ids = exchanged_ids();
  nccl_.check(nccl_.group_start(), "a group");
  for (std::size_t i = 0; i < gpus_.count(); ++i) {
    const OnDevice here(gpus_[i].device());
    nccl_.check(nccl_.comm_init_rank(&communicators_[i], process_.count, ids[i], process_.rank),
                "connecting the processes");
  }
  nccl_.check(nccl_.group_end(), "connecting the processes");
  std::vector<Buffer<std::uint8_t>> bytes;
  std::vector<Piece> pieces;
  for (std::size_t i = 0; i < gpus_.count(); ++i) {
    bytes.emplace_back(gpus_[i].memory).resize_discard(count());
    for (std::size_t from = 0; from < count(); ++from)
      pieces.push_back({from, i, bytes[i].data() + from, 1});
  }
  share(pieces);
  gpus_.streams().synchronize();
  rest();
  has_met_ = true;
  if (process_.rank == 0) fs::remove(process_.meeting_file);  // all have read it
}

// Process 0 makes them.
std::vector<NcclId> Processes::exchanged_ids() const {
  std::vector<NcclId> ids(gpus_.count());
  const std::streamsize bytes = std::streamsize(ids.size() * sizeof(NcclId));
  if (process_.rank == 0) {
    for (NcclId& id : ids) nccl_.check(nccl_.get_unique_id(&id), "making an identifier");
    write_ids(process_.meeting_file, ids);
    return ids;
  }
  while (true) {  // watch() ends this
    std::error_code error;
    const auto size = fs::file_size(process_.meeting_file, error);
    if (!error && std::streamsize(size) != bytes)
      throw UsageError("process 0 has " + std::to_string(size / sizeof(NcclId)) +
                       " GPUs, and process " + std::to_string(process_.rank) + " has " +
                       std::to_string(ids.size()) + "; give each the same number (train.ranks)");
    std::ifstream file(process_.meeting_file, std::ios::binary);
    if (file.read(reinterpret_cast<char*>(ids.data()), bytes)) return ids;
    std::this_thread::sleep_for(kBetweenLooks);
  }
}

void Processes::end_watch() {
  {
    const std::scoped_lock lock(mutex_);
    is_over_ = true;
  }
  changed_.notify_all();
  watch_.join();
}

void Processes::watch() {
  const auto deadline = Clock::now() + kMeetingTime;
  const std::string name =
      "process " + std::to_string(process_.rank) + " of " + std::to_string(process_.count);
  std::unique_lock lock(mutex_);
  while (!changed_.wait_for(lock, kBetweenLooks, [this] { return is_over_; })) {
    if (!has_met_) {
      if (Clock::now() > deadline)
        end_process(name + " has waited " + std::to_string(kMeetingTime.count()) +
                    " s for the others; start all of them at the same time, with the same output " +
                    "on a disk that they share");
      continue;
    }
    if (!is_sharing_) continue;
    for (NcclCommunicator* const communicator : communicators_) {
      int error = kNcclSuccess;
      int result = nccl_.comm_get_async_error(communicator, &error);
      if (result == kNcclSuccess) result = error;
      if (result != kNcclSuccess && result != kNcclInProgress)
        end_process("another process of this run has ended, so " + name +
                    " ends, too (NCCL: " + nccl_.get_error_string(result) + ")" + process_.advice);
    }
  }
}

void Processes::share(const std::vector<Piece>& pieces) {
  is_sharing_ = true;
  nccl_.check(nccl_.group_start(), "a group");
  for (const Piece& piece : pieces)
    nccl_.check(nccl_.broadcast(piece.data, piece.data, piece.bytes, kNcclInt8, int(piece.from),
                                communicators_[piece.gpu], gpus_[piece.gpu].context.stream()),
                "sharing");
  nccl_.check(nccl_.group_end(), "sharing");
}

void Processes::check_same(std::uint64_t value, const std::string& what) {
  Buffer<std::uint64_t> values(gpus_.first().memory);
  values.upload(std::vector<std::uint64_t>(count(), value));
  std::vector<Piece> pieces;
  for (std::size_t from = 0; from < count(); ++from)
    pieces.push_back({from, 0, values.data() + from, sizeof value});
  share(pieces);
  const std::vector<std::uint64_t> all = values.download();
  rest();
  for (std::size_t other = 0; other < all.size(); ++other)
    if (all[other] != value)
      throw Error("process " + std::to_string(other) + " has other " + what + " than process " +
                  std::to_string(process_.rank) + "; give all of them the same");
}

}  // namespace gs::cuda
