// SPDX-License-Identifier: Apache-2.0
// Links by NCCL.
#include <cuda_runtime_api.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <thread>

#include "cuda/ranks/device_link.h"
#include "cuda/ranks/nccl.h"
#include "gs_core/error.h"
#include "gs_core/processes/packing.h"

namespace gs::cuda {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kTimeToGiveUp{10};

void check(const Nccl& nccl, int result, const char* what) {
  if (result == kNcclSuccess || result == kNcclInProgress) return;
  std::string why = nccl.get_error_string(result);
  if (nccl.get_last_error)
    if (const char* const last = nccl.get_last_error(nullptr); last && *last)
      why += std::string(" (") + last + ")";
  throw Error(std::string("NCCL failed in ") + what + ": " + why +
              "; set NCCL_DEBUG=WARN to see more");
}

void check(cudaError_t error, const char* what) {
  if (error != cudaSuccess)
    throw Error(std::string("the GPU failed in ") + what + ": " + cudaGetErrorString(error));
}

// A communicator. A thread that hangs in it keeps it.
class Communicator {
 public:
  explicit Communicator(const Nccl& nccl) : nccl_(nccl) {}
  ~Communicator() {
    if (handle_ && !is_given_up_) nccl_.comm_destroy(handle_);
  }
  void connect(int device, int rank, int count, const NcclId& id) {
    check(cudaSetDevice(device), "choosing the GPU");
    NcclCommunicator* handle = nullptr;
    check(nccl_, nccl_.comm_init_rank(&handle, count, id, rank), "connecting the ranks");
    {
      const std::scoped_lock lock(calls_);
      handle_ = handle;
      if (is_given_up_) nccl_.comm_abort(handle_);
    }
    greet(rank, count);
  }
  void exchange(const std::vector<DevicePiece>& sent, const std::vector<DevicePiece>& received,
                CUstream_st* stream) {
    const std::scoped_lock lock(calls_);
    check_now();
    if (sent.empty() && received.empty()) return;
    check(nccl_, nccl_.group_start(), "a group");
    for (const DevicePiece& piece : sent)
      check(nccl_, nccl_.send(piece.data, piece.bytes, kNcclInt8, piece.rank, handle_, stream),
            "sending");
    for (const DevicePiece& piece : received)
      check(nccl_, nccl_.recv(piece.data, piece.bytes, kNcclInt8, piece.rank, handle_, stream),
            "receiving");
    check(nccl_, nccl_.group_end(), "an exchange");
  }
  void check_is_up() {
    const std::scoped_lock lock(calls_);
    check_now();
  }
  // True the first time.
  bool begin_to_give_up() { return !is_given_up_.exchange(true); }
  // A call that goes on for long waits for the lost rank, and only this ends it.
  void abort() {
    const bool is_alone = calls_.try_lock_for(std::chrono::seconds(1));
    if (handle_) nccl_.comm_abort(handle_);
    if (is_alone) calls_.unlock();
  }

 private:
  void check_now() {
    if (is_given_up_) throw LinkLost{};
    int error = kNcclSuccess;
    check(nccl_, nccl_.comm_get_async_error(handle_, &error), "asking for errors");
    check(nccl_, error, "an exchange");
  }
  // NCCL connects two ranks when they first send: all do so now, while somebody watches.
  void greet(int rank, int count) {
    cudaStream_t stream = nullptr;
    void* memory = nullptr;
    check(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking), "making a stream");
    check(cudaMalloc(&memory, std::size_t(2 * count)), "allocating memory");
    std::byte* const room = static_cast<std::byte*>(memory);
    std::vector<DevicePiece> sent, received;
    for (int other = 0; other < count; ++other) {
      if (other == rank) continue;
      sent.push_back({other, room + other, 1});
      received.push_back({other, room + count + other, 1});
    }
    exchange(sent, received, stream);
    check(cudaStreamSynchronize(stream), "the first exchange");
    cudaFree(memory);
    cudaStreamDestroy(stream);
  }

  const Nccl nccl_;
  std::timed_mutex calls_;  // of NCCL by this rank
  std::atomic<NcclCommunicator*> handle_ = nullptr;
  std::atomic<bool> is_given_up_ = false;
};

class NcclLink final : public DeviceLink {
 public:
  explicit NcclLink(std::shared_ptr<Communicator> communicator)
      : communicator_(std::move(communicator)) {}
  void exchange(const std::vector<DevicePiece>& sent, const std::vector<DevicePiece>& received,
                CUstream_st* stream) override {
    communicator_->exchange(sent, received, stream);
  }
  void check() override { communicator_->check_is_up(); }
  // Where NCCL hangs even then, nothing but the end of the process helps.
  void give_up() noexcept override {
    if (!communicator_->begin_to_give_up()) return;
    const auto has_ended = std::make_shared<std::atomic<bool>>(false);
    try {
      std::thread([has_ended, communicator = communicator_] {
        communicator->abort();
        *has_ended = true;
      }).detach();
    } catch (const std::exception&) {  // no thread can be started
      communicator_->abort();
      return;
    }
    for (const auto end = Clock::now() + kTimeToGiveUp; !*has_ended;) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      if (Clock::now() < end) continue;
      std::fputs("error: another rank is lost, and NCCL does not end; see the last checkpoint\n",
                 stderr);
      ::_exit(int(ExitCode::bad_data));
    }
  }

 private:
  const std::shared_ptr<Communicator> communicator_;
};

class NcclLinks final : public DeviceLinks {
 public:
  explicit NcclLinks(const Nccl& nccl) : nccl_(nccl) {}
  std::vector<std::byte> invitation() override {
    Invitation invitation{};
    nccl_.get_version(&invitation.version);
    check(nccl_, nccl_.get_unique_id(&invitation.id), "making an identifier");
    Packer packer;
    packer.value(invitation);
    return packer.take();
  }
  std::unique_ptr<DeviceLink> connect(int device, int rank, int count,
                                      const std::vector<std::byte>& message,
                                      const std::function<void()>& keep_watch) override {
    const auto invitation = Unpacker(message).value<Invitation>();
    int version = 0;
    nccl_.get_version(&version);
    if (version != invitation.version)
      throw Error("NCCL is " + nccl_version_text(version) + ", and that of rank 0 is " +
                  nccl_version_text(invitation.version) +
                  "; let GEMSPLAT_NCCL name the same version for all ranks");
    const auto attempt = std::make_shared<Attempt>(nccl_);
    // NCCL waits for the other ranks without a deadline. If one never comes, the thread is left
    // behind.
    std::thread([=] {
      try {
        attempt->communicator->connect(device, rank, count, invitation.id);
      } catch (...) {
        attempt->failure = std::current_exception();
      }
      attempt->has_ended = true;
    }).detach();
    while (!attempt->has_ended) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      keep_watch();
    }
    if (attempt->failure) std::rethrow_exception(attempt->failure);
    return std::make_unique<NcclLink>(attempt->communicator);
  }

 private:
  struct Invitation {
    int version;
    NcclId id;
  };
  struct Attempt {
    explicit Attempt(const Nccl& nccl) : communicator(std::make_shared<Communicator>(nccl)) {}
    std::shared_ptr<Communicator> communicator;
    std::exception_ptr failure;
    std::atomic<bool> has_ended = false;
  };

  const Nccl nccl_;
};

}  // namespace

std::unique_ptr<DeviceLinks> make_nccl_links() {
  const char* const file = std::getenv("GEMSPLAT_NCCL");
  return std::make_unique<NcclLinks>(load_nccl(file && *file ? file : "libnccl.so.2"));
}

}  // namespace gs::cuda
