// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/quality_curves.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "gs_app/report/report_curves.h"
#include "gs_app/run/page_text.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

// Pixels.
constexpr double kWidth = 420, kHeight = 260;  // of the area of a chart
constexpr double kLeft = 64, kTop = 34, kBottom = 46, kGap = 24, kLegendRow = 20;
constexpr int kTicks = 5;

// Of the light theme (apps/web/shared/theme.css)
constexpr const char* kColors[] = {"#2457d6", "#d2480c", "#0b8a60", "#8a3fd1", "#bf2a62",
                                   "#0b7891", "#97650a", "#5b6779", "#5d7a10", "#8d4a2b"};

/// A metric that metrics.csv has a column of.
struct Charted {
  const char *column, *title;
};
constexpr Charted kCharted[] = {{"test_psnr", "PSNR / dB"}, {"test_ssim", "SSIM"}};

struct Point {
  double seconds, value;
};
using Curve = std::map<std::int64_t, Point>;  // by step

/// The curves of one chart, by config.
using Chart = std::vector<std::pair<std::string, std::vector<Curve>>>;

Curve curve_of(const Json& columns, const char* column) {
  Curve curve;
  if (!columns.contains(column) || !columns.contains("seconds")) return curve;
  for (std::size_t i = 0; i < columns["step"].size(); ++i) {
    const Json &step = columns["step"][i], &seconds = columns["seconds"][i];
    const Json& value = columns[column][i];
    if (step.is_number_integer() && seconds.is_number() && value.is_number())
      curve[step.get<std::int64_t>()] = {seconds.get<double>(), value.get<double>()};
  }
  return curve;
}

// Of the steps that all curves have.
Curve mean_of(const std::vector<Curve>& curves) {
  Curve mean;
  for (const auto& [step, first] : curves.front()) {
    Point sum{0, 0};
    std::size_t count = 0;
    for (const Curve& curve : curves) {
      const auto point = curve.find(step);
      if (point == curve.end()) break;
      sum = {sum.seconds + point->second.seconds, sum.value + point->second.value};
      ++count;
    }
    if (count == curves.size())
      mean[step] = {sum.seconds / double(count), sum.value / double(count)};
  }
  return mean;
}

/// From a value to a pixel, with round values as ticks.
class Axis {
 public:
  Axis(double low, double high, double first, double last) : first_(first), last_(last) {
    if (!(high > low)) low -= 0.5, high += 0.5;
    const double rough = (high - low) / kTicks, power = std::pow(10, std::floor(std::log10(rough)));
    for (const double factor : {1, 2, 5, 10})
      if (step_ == 0 && factor * power >= rough) step_ = factor * power;
    low_ = std::floor(low / step_) * step_;
    high_ = std::ceil(high / step_) * step_;
  }
  double at(double value) const {
    return first_ + (value - low_) / (high_ - low_) * (last_ - first_);
  }

  std::vector<double> ticks() const {
    std::vector<double> ticks;
    for (int i = 0; i <= 2 * kTicks; ++i)
      if (const double tick = low_ + i * step_; tick < high_ + 0.5 * step_) ticks.push_back(tick);
    return ticks;
  }
  std::string text(double tick) const {
    const int digits = int(std::clamp(-std::floor(std::log10(step_) + 1e-9), 0.0, 9.0));
    return fmt::format("{:.{}f}", tick, digits);
  }

 private:
  double first_, last_, low_ = 0, high_ = 1, step_ = 0;
};

std::string polyline(const Curve& curve, const Axis& x, const Axis& y, const char* color,
                     const char* more) {
  std::string points, dots;
  for (const auto& [step, point] : curve) {
    const double px = x.at(point.seconds), py = y.at(point.value);
    points += fmt::format("{:.1f},{:.1f} ", px, py);
    dots += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='2.5'/>", px, py);
  }
  return fmt::format("<g stroke='{0}' fill='{0}' {1}><polyline fill='none' points='{2}'/>{3}</g>\n",
                     color, more, points, dots);
}

std::string chart_svg(const Chart& chart, const std::string& title, double left, double top) {
  Point low{0, std::numeric_limits<double>::infinity()}, high{0, -low.value};
  for (const auto& [config, curves] : chart)
    for (const Curve& curve : curves)
      for (const auto& [step, point] : curve) {
        high.seconds = std::max(high.seconds, point.seconds);
        low.value = std::min(low.value, point.value);
        high.value = std::max(high.value, point.value);
      }
  const double right = left + kWidth, bottom = top + kHeight;
  const Axis x(low.seconds, high.seconds, left, right), y(low.value, high.value, bottom, top);
  std::string text = fmt::format("<text x='{}' y='{}' class='title'>{}</text>\n", left, top - 12,
                                 html_text(title));
  for (const double tick : x.ticks())
    text += fmt::format(
        "<line x1='{0:.1f}' x2='{0:.1f}' y1='{1}' y2='{2}'/>"
        "<text x='{0:.1f}' y='{3}' text-anchor='middle'>{4}</text>\n",
        x.at(tick), top, bottom, bottom + 16, x.text(tick));
  for (const double tick : y.ticks())
    text += fmt::format(
        "<line x1='{}' x2='{}' y1='{:.1f}' y2='{:.1f}'/>"
        "<text x='{}' y='{:.1f}' text-anchor='end'>{}</text>\n",
        left, right, y.at(tick), y.at(tick), left - 6, y.at(tick) + 4, y.text(tick));
  text += fmt::format("<text x='{}' y='{}' text-anchor='middle'>training / s</text>\n",
                      left + kWidth / 2, bottom + 34);
  for (std::size_t i = 0; i < chart.size(); ++i) {
    const std::vector<Curve>& curves = chart[i].second;
    if (curves.empty()) continue;
    const char* color = kColors[i % std::size(kColors)];
    if (curves.size() > 1)
      for (const Curve& curve : curves) text += polyline(curve, x, y, color, "opacity='0.3'");
    text += polyline(mean_of(curves), x, y, color, "stroke-width='2'");
  }
  return text;
}

std::string legend(const std::vector<std::string>& configs, double top) {
  std::string text;
  for (std::size_t i = 0; i < configs.size(); ++i) {
    const double y = top + kLegendRow * double(i);
    text += fmt::format(
        "<rect x='{}' y='{}' width='18' height='4' fill='{}'/><text x='{}' y='{}'>{}</text>\n",
        kLeft, y - 5, kColors[i % std::size(kColors)], kLeft + 26, y, html_text(configs[i]));
  }
  return text;
}

}  // namespace

std::string quality_curves(const std::vector<RunRow>& rows) {
  constexpr std::size_t kMostRows = 3000;  // without an evaluation; all others are kept
  std::vector<std::string> scenes, configs;
  std::map<std::string, std::map<std::string, std::vector<Json>>> columns;  // by scene and config
  for (const RunRow& row : rows) {
    add_name(row.run->config, configs);
    if (row.results.is_null()) continue;
    try {
      const Json read = metrics_columns(row.run->folder.metrics(), kMostRows);
      if (curve_of(read, kCharted[0].column).empty()) continue;
      add_name(row.run->scene, scenes);
      columns[row.run->scene][row.run->config].push_back(read);
    } catch (const Error&) {  // the report names the file
    }
  }
  if (scenes.empty()) return "";
  std::string charts;
  double top = kTop;
  for (const std::string& scene : scenes) {
    double left = kLeft;
    for (const Charted& charted : kCharted) {
      Chart chart;
      for (const std::string& config : configs) {
        chart.push_back({config, {}});
        for (const Json& read : columns[scene][config])
          chart.back().second.push_back(curve_of(read, charted.column));
      }
      charts += chart_svg(chart, fmt::format("{}: {}", scene, charted.title), left, top);
      left += kWidth + kGap + kLeft;
    }
    top += kHeight + kBottom + kTop;
  }
  charts += legend(configs, top);
  const double width = 2 * (kLeft + kWidth + kGap);
  const double height = top + kLegendRow * double(configs.size());
  return fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {0} {1}' width='{0}' height='{1}'>\n"
      "<style>text {{ font: 12px sans-serif; fill: #333 }} .title {{ font-weight: bold }} "
      "line {{ stroke: #ddd }}</style>\n"
      "<rect width='{0}' height='{1}' fill='white'/>\n{2}</svg>\n",
      width, height, charts);
}

}  // namespace gs
