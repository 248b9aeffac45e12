// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/viewers.h"

#include <arpa/inet.h>
#include <spdlog/fmt/fmt.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <thread>

#include "gs_app/studio/job_log.h"
#include "gs_app/view/http/http_parse.h"
#include "gs_core/error.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t kMostViewers = 2;
constexpr milliseconds kLook{30};
constexpr milliseconds kLongestStart{120'000};  // a large model gets levels of detail first
constexpr int kAnswerSeconds = 120;
constexpr std::size_t kLongestAnswer = std::size_t(2) << 30;  // bytes
constexpr std::size_t kPieceOfAnswer = std::size_t(1) << 16;

std::string in_address(const std::string& text) {
  std::string result;
  for (const char c : text)
    result += std::isalnum(static_cast<unsigned char>(c))
                  ? std::string(1, c)
                  : fmt::format("%{:02X}", static_cast<unsigned char>(c));
  return result;
}

std::string head_to_forward(int port, const HttpRequest& request, const std::string& path) {
  std::string head = request.method + " " + path;
  for (const auto& [name, value] : request.query)
    head += (head.find('?') == head.npos ? "?" : "&") + in_address(name) + "=" + in_address(value);
  head += fmt::format(" HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n", port);
  if (!request.token.empty()) head += "X-Control-Token: " + request.token + "\r\n";
  if (!request.range.empty()) head += "Range: " + request.range + "\r\n";
  return head + "\r\n";
}

// All that the server says; empty where it says nothing.
std::string said_by(int port, const std::string& head) {
  const Descriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(std::uint16_t(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const timeval longest{kAnswerSeconds, 0};
  ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &longest, sizeof longest);
  if (::connect(socket, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
      ::send(socket, head.data(), head.size(), MSG_NOSIGNAL) != ssize_t(head.size()))
    return {};
  std::string answer;
  std::vector<char> piece(kPieceOfAnswer);
  for (ssize_t got = 0; (got = ::recv(socket, piece.data(), piece.size(), 0)) > 0;) {
    if (answer.size() > kLongestAnswer) return {};
    answer.append(piece.data(), std::size_t(got));
  }
  return answer;
}

bool has_ended(pid_t child) {
  siginfo_t info{};
  return ::waitid(P_PID, id_t(child), &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid != 0;
}

}  // namespace

HttpAnswer forwarded(int port, const HttpRequest& request, const std::string& path) {
  std::string text = said_by(port, head_to_forward(port, request, path));
  const std::size_t length = head_length(text, 0);
  // The first line of an answer has its words in another order than that of a request.
  const std::size_t line = text.find("\r\n");
  const auto head =
      length == 0 ? std::nullopt : parse_head("GET / HTTP/1.1" + text.substr(line, length - line));
  if (!head) return http_error(502, "this view has ended; open it again");
  HttpAnswer answer;
  answer.status = std::atoi(text.c_str() + std::string_view("HTTP/1.1 ").size());
  answer.type = head->value("content-type");
  for (const char* name : {"content-range", "accept-ranges", "x-render-ms"})
    if (const std::string value = head->value(name); !value.empty())
      answer.headers.emplace_back(name, value);
  text.erase(0, length);
  answer.body = std::make_shared<const std::string>(std::move(text));
  return answer;
}

int port_in(const std::string& url) {
  constexpr std::string_view kStart = "http://127.0.0.1:";
  int port = 0;
  if (url.starts_with(kStart))
    std::from_chars(url.data() + kStart.size(), url.data() + url.size(), port);
  return port;
}

Viewers::~Viewers() {
  for (const Viewer& viewer : viewers_) {
    ::kill(viewer.child, SIGTERM);
    wait_for_child(viewer.child);
  }
}

int Viewers::open(const std::filesystem::path& folder, const std::vector<std::string>& words,
                  const std::string& time) {
  const std::lock_guard lock(mutex_);
  for (auto at = viewers_.begin(); at != viewers_.end(); ++at) {
    if (at->folder != folder || at->words != words || at->time != time || has_ended(at->child))
      continue;
    viewers_.splice(viewers_.begin(), viewers_, at);
    return at->port;
  }
  if (viewers_.size() >= kMostViewers) {
    ::kill(viewers_.back().child, SIGTERM);
    wait_for_child(viewers_.back().child);
    viewers_.pop_back();
  }
  viewers_.push_front(start(folder, words, time));
  return viewers_.front().port;
}

bool Viewers::has(int port) {
  const std::lock_guard lock(mutex_);
  return std::any_of(viewers_.begin(), viewers_.end(),
                     [&](const Viewer& viewer) { return viewer.port == port; });
}

Viewers::Viewer Viewers::start(const std::filesystem::path& folder,
                               const std::vector<std::string>& words, const std::string& time) {
  const std::filesystem::path file = folder / "jobs" / "view.log";
  std::vector<std::string> command = {program_to_start().string(), "view"};
  command.insert(command.end(), words.begin(), words.end());
  for (const char* word : {"--no-open", "--port", "0", "--json", "--progress", "json"})
    command.emplace_back(word);
  std::filesystem::remove(file);  // the one that another viewer holds goes on without a name
  pid_t child = 0;
  {
    const Descriptor log = new_job_log(file);
    child = start_child(command, {.output = log, .folder = folder});
  }
  JobLog log(file);
  for (milliseconds waited{0}; waited < kLongestStart; waited += kLook) {
    const bool lives = is_job_alive(file);
    log.update();
    if (log.outcome.is_object() && log.outcome.contains("url"))
      return {folder, words, time, child, port_in(log.outcome["url"])};
    if (!lives) break;
    std::this_thread::sleep_for(kLook);
  }
  ::kill(child, SIGKILL);
  wait_for_child(child);
  throw Error(log.error.empty() ? "the viewer did not start; start it with the command"
                                : log.error);
}

}  // namespace gs
