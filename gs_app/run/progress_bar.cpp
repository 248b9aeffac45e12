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
constexpr std::size_t kWidestBar = 24, kNarrowestBar = 4;  // characters
constexpr const char* kEraseLine = "\r\033[K";

double seconds_of(std::chrono::steady_clock::time_point time) {
  return std::chrono::duration<double>(time.time_since_epoch()).count();
}

int terminal_width() {
  winsize size{};
  return ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 100;
}

ProgressStyle g_style = ProgressStyle::bar;
std::function<void(const Json&)> g_sink;

std::string joined(const ProgressFigures& figures) {
  const std::string middle = figures.detail.empty() ? "" : " | " + figures.detail;
  return figures.done + middle + " | " + figures.rest;
}

}  // namespace

void set_progress_style(ProgressStyle style) { g_style = style; }

void set_progress_sink(std::function<void(const Json&)> sink) { g_sink = std::move(sink); }

void write_progress_json(const Json& json) {
  if (g_sink) return g_sink(json);
  const std::string line = json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  std::fwrite(line.data(), 1, line.size(), stderr);
}

std::string progress_line(double share, const ProgressFigures& figures, std::size_t columns) {
  constexpr std::size_t kFrame = 3;  // of the bar: "[] "
  std::string text = joined(figures);
  if (text.size() > columns) {
    ProgressFigures shorter = figures;
    const std::size_t over = std::min(text.size() - columns, figures.detail.size());
    shorter.detail.resize(figures.detail.size() - over);
    text = joined(shorter);
    text.resize(std::min(text.size(), columns));
  }
  const std::size_t room = columns - text.size();
  if (room < kFrame + kNarrowestBar) return text;
  const std::size_t width = std::min(room - kFrame, kWidestBar),
                    filled = std::size_t(std::clamp(share, 0.0, 1.0) * double(width));
  return fmt::format("[{}{}] {}", std::string(filled, '='), std::string(width - filled, ' '), text);
}

ProgressBar::ProgressBar(std::int64_t total, bool enabled, std::int64_t done)
    : total_(std::max<std::int64_t>(total, 1)), enabled_(enabled),
      is_terminal_(::isatty(STDERR_FILENO) == 1), next_tenth_(done * 10 / total_ + 1),
      rate_(done, seconds_of(start_)) {}

bool ProgressBar::due(std::int64_t done) {
  if (!enabled_ || g_style == ProgressStyle::none) return false;
  const Clock::time_point now = Clock::now();
  if (is_terminal_ || g_style == ProgressStyle::json)
    return done >= total_ || now - last_time_ >= kRedrawEvery;
  const bool is_next = done * 10 >= next_tenth_ * total_ || now - last_time_ >= kLogEvery;
  return is_next && now - start_ >= kQuietStart;
}

void ProgressBar::draw(std::int64_t done, const std::string& detail, const std::string& unit) {
  last_time_ = Clock::now();
  rate_.note(done, seconds_of(last_time_));
  const double rate = rate_.rate();
  if (g_style == ProgressStyle::json) {
    Json json = {{"event", "progress"}, {"part", detail},  {"unit", unit},
                 {"done", done},        {"total", total_}, {"per_second", rate}};
    if (rate > 0) json["seconds_left"] = double(total_ - done) / rate;
    return write_progress_json(json);
  }
  const ProgressFigures figures = {
      fmt::format("{}/{}", done, total_), detail,
      fmt::format("{:.{}f} {}/s | {} left", rate, rate < 100 ? 1 : 0, unit,
                  rate > 0 ? clock_text(double(total_ - done) / rate) : "?")};
  if (!is_terminal_) {
    next_tenth_ = done * 10 / total_ + 1;
    fmt::print(stderr, "{:3d}% {}\n", done * 100 / total_, joined(figures));
    return;
  }
  const double share = double(done) / double(total_);
  fmt::print(stderr, "{}{}", kEraseLine,
             progress_line(share, figures, std::size_t(terminal_width() - 1)));
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
