// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/http/http_workers.h"

#include <iterator>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/plain_message.h"
#include "gs_core/threads/low_priority.h"
#include "gs_core/threads/parallel.h"
#include "gs_core/threads/start_threads.h"

namespace gs {
namespace {

// If more requests wait, the newest one of the address with the fewest is answered first: in a flood,
// a person who opens the page does not wait for all requests that came before.
constexpr std::size_t kCrowd = 16;

// The reason is for who started the program, not for who asks: it may name folders of this machine.
HttpAnswer internal_error(const std::exception& error) {
  log_warning("the viewer could not answer a request: {}", plain_message(error));
  return http_error(500, "this could not be computed; the messages of the program say why");
}

HttpAnswer answer_of(const HttpHandler& handler, const HttpRequest& request) {
  try {
    return handler(request);
  } catch (const std::exception& error) {
    return internal_error(error);
  }
}

std::unique_ptr<HttpReply> reply_of(const HttpAnswer& answer, const HttpJob& job) {
  try {
    return std::make_unique<HttpReply>(answer, job.has_body, job.request.range);
  } catch (const Error& error) {  // its file cannot be read
    return std::make_unique<HttpReply>(internal_error(error), job.has_body);
  }
}

// Null if memory runs out.
std::unique_ptr<HttpReply> reply_or_null(const HttpHandler& handler, const HttpJob& job) {
  try {
    return reply_of(answer_of(handler, job.request), job);
  } catch (const std::exception&) {
    return nullptr;
  }
}

}  // namespace

HttpWorkers::HttpWorkers(HttpHandler handler, int threads, std::function<void()> on_result)
    : handler_(std::move(handler)), on_result_(std::move(on_result)) {
  start_threads(threads_, threads, [this] { serve(); });
  if (threads_.empty()) throw Error("cannot start the threads of a server; end other programs");
}

HttpWorkers::~HttpWorkers() {
  {
    const std::lock_guard lock(mutex_);
    quit_ = true;
    waiting_.clear();
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void HttpWorkers::add(HttpJob job) {
  {
    const std::lock_guard lock(mutex_);
    // Memory for their results, so that no worker has to ask for it.
    results_.reserve(results_.size() + waiting_.size() + 1 + threads_.size());
    waiting_.push_back(std::move(job));
  }
  changed_.notify_one();
}

bool HttpWorkers::drop(std::uint64_t connection) {
  const std::lock_guard lock(mutex_);
  return std::erase_if(waiting_, [&](const HttpJob& job) { return job.connection == connection; }) >
         0;
}

std::vector<HttpResult> HttpWorkers::results() {
  const std::lock_guard lock(mutex_);
  std::vector<HttpResult> taken(std::make_move_iterator(results_.begin()),
                                std::make_move_iterator(results_.end()));
  results_.clear();  // and keeps its memory
  return taken;
}

HttpJob HttpWorkers::next_job() {
  auto next = waiting_.begin();
  if (waiting_.size() > kCrowd) {
    std::unordered_map<std::string_view, int> counts;
    for (const HttpJob& job : waiting_) ++counts[job.request.client];
    for (auto it = waiting_.begin(); it != waiting_.end(); ++it)
      if (counts[it->request.client] <= counts[next->request.client]) next = it;
  }
  HttpJob job = std::move(*next);
  waiting_.erase(next);
  return job;
}

void HttpWorkers::serve() {
  lower_priority_once();
  const SerialLoops beside_training;
  for (std::unique_lock lock(mutex_);;) {
    changed_.wait(lock, [&] { return quit_ || !waiting_.empty(); });
    if (quit_) return;
    const HttpJob job = next_job();
    lock.unlock();
    std::unique_ptr<HttpReply> reply = reply_or_null(handler_, job);
    lock.lock();
    results_.push_back({job.connection, std::move(reply)});
    on_result_();
  }
}

}  // namespace gs
