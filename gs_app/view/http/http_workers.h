// SPDX-License-Identifier: Apache-2.0
// Threads of low priority that compute the answers to requests.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "gs_app/view/http/http_reply.h"
#include "gs_app/view/http/http_server.h"

namespace gs {

/// A request, and the number of the connection that it came from.
struct HttpJob {
  std::uint64_t connection = 0;
  HttpRequest request;
  bool has_body = true;  // false for HEAD
};

/// The answer to a job.
struct HttpResult {
  std::uint64_t connection;
  std::unique_ptr<HttpReply> reply;  // null if there is too little memory for one
};

/// All functions except the destructor may be called from any thread.
class HttpWorkers {
 public:
  /// Calls `on_result` from its threads when results() has a new one. Throws Error if the system
  /// allows no thread at all; with fewer threads than asked for, it goes on.
  HttpWorkers(HttpHandler handler, int threads, std::function<void()> on_result);
  /// Drops the jobs that wait, and returns when those under way are done.
  ~HttpWorkers();
  HttpWorkers(const HttpWorkers&) = delete;
  HttpWorkers& operator=(const HttpWorkers&) = delete;

  void add(HttpJob job);
  /// Takes a job back that waits. False if it is under way or done.
  bool drop(std::uint64_t connection);
  /// The results since the last call.
  std::vector<HttpResult> results();

 private:
  void serve();
  HttpJob next_job();  // mutex_ is held, and a job waits

  const HttpHandler handler_;
  const std::function<void()> on_result_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<HttpJob> waiting_;
  std::vector<HttpResult> results_;
  bool quit_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace gs
