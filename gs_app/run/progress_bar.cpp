// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/progress_bar.h"

#include <spdlog/fmt/fmt.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "gs_app/run/text.h"

namespace gs {
namespace {

constexpr std::chrono::milliseconds kRedrawEvery{200};
constexpr std::chrono::seconds kQuietStart{1};  // work shorter than this needs no lines in a log
constexpr std::chrono::minutes kLogEvery{5};    // without a terminal; or at each tenth of the way
constexpr int kBarWidth = 24;                   // characters
constexpr const char* kEraseLine = "\r\033[K";

double seconds_of(std::chrono::steady_clock::time_point time) {
  return std::chrono::duration<double>(time.time_since_epoch()).count();
}

int terminal_width() {
  winsize size{};
  return ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 100;
}

}  // namespace

ProgressBar::ProgressBar(std::int64_t total, bool enabled, std::int64_t done)
    : total_(std::max<std::int64_t>(total, 1)), enabled_(enabled),
      is_terminal_(::isatty(STDERR_FILENO) == 1), next_tenth_(done * 10 / total_ + 1),
      rate_(done, seconds_of(start_)) {}

bool ProgressBar::due(std::int64_t done) {
  if (!enabled_) return false;
  const Clock::time_point now = Clock::now();
  if (is_terminal_) return done >= total_ || now - last_time_ >= kRedrawEvery;
  const bool is_next = done * 10 >= next_tenth_ * total_ || now - last_time_ >= kLogEvery;
  return is_next && now - start_ >= kQuietStart;
}

void ProgressBar::draw(std::int64_t done, const std::string& detail, const std::string& unit) {
  last_time_ = Clock::now();
  rate_.note(done, seconds_of(last_time_));
  const double rate = rate_.rate();
  const std::string figures = fmt::format(
      "{}/{}{}{} | {:.{}f} {}/s | {} left", done, total_, detail.empty() ? "" : " | ", detail, rate,
      rate < 100 ? 1 : 0, unit, rate > 0 ? clock_text(double(total_ - done) / rate) : "?");
  if (!is_terminal_) {
    next_tenth_ = done * 10 / total_ + 1;
    fmt::print(stderr, "{:3d}% {}\n", done * 100 / total_, figures);
    return;
  }
  const int filled = int(done * kBarWidth / total_);
  std::string line = fmt::format("[{}{}] {}", std::string(std::size_t(filled), '='),
                                 std::string(std::size_t(kBarWidth - filled), ' '), figures);
  line.resize(std::min(line.size(), std::size_t(terminal_width() - 1)));
  fmt::print(stderr, "{}{}", kEraseLine, line);
  std::fflush(stderr);
  line_is_drawn_ = true;
}

void ProgressBar::clear() {
  if (!line_is_drawn_) return;
  fmt::print(stderr, "{}", kEraseLine);
  std::fflush(stderr);
  line_is_drawn_ = false;
}

}  // namespace gs
