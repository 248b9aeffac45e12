// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/benchmark_comparison.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

constexpr const char* kRemedyOfBenchmarks = "name a file that `gemsplat bench -o FILE` wrote";

// A member of an object, or nothing.
const Json* member(const Json& json, const char* name) {
  if (!json.is_object()) return nullptr;
  const auto found = json.find(name);
  return found == json.end() || found->is_null() ? nullptr : &*found;
}
std::optional<double> number(const Json& json, const char* name) {
  const Json* const value = member(json, name);
  return value && value->is_number() ? std::optional<double>(value->get<double>()) : std::nullopt;
}
std::string words(const Json& json, const char* name) {
  const Json* const value = member(json, name);
  return value && value->is_string() ? value->get<std::string>() : "";
}

// Width and height of a picture.
using Size = std::pair<int, int>;
Size size_of(const Json& json) {
  return {int(number(json, "width").value_or(0)), int(number(json, "height").value_or(0))};
}

std::optional<double> milliseconds_of_step(const Json& report) {
  const Json* const train = member(report, "train");
  return train ? number(*train, "ms_per_step") : std::nullopt;
}

const Json* frames(const Json& report) {
  const Json* const render = member(report, "render");
  return render && render->is_array() && !render->empty() ? render : nullptr;
}
// The fastest way of a size: reports of older versions may have several.
std::optional<double> milliseconds_of_frame(const Json& report, const Size& size) {
  std::optional<double> least;
  if (const Json* const all = frames(report))
    for (const Json& frame : *all)
      if (const auto ms = number(frame, "ms_per_frame"); ms && size_of(frame) == size)
        least = std::min(least.value_or(*ms), *ms);
  return least;
}

std::string or_nothing(const std::optional<double>& value, const char* form) {
  return value ? fmt::format(fmt::runtime(form), *value) : "";
}

class Table {
 public:
  explicit Table(const std::vector<const OtherReport*>& reports) : reports_(reports) {
    std::string rule = "|---|";
    text_ = "| |";
    for (const OtherReport* report : reports) {
      text_ += " " + report->name + " |";
      rule += "---|";
    }
    text_ += "\n" + rule + "\n";
  }

  template <class Cell>
  void row(const std::string& title, const Cell& cell) {
    text_ += "| " + title + " |";
    for (const OtherReport* report : reports_) text_ += " " + cell(report->figures) + " |";
    text_ += "\n";
  }
  // A row of figures, with the ratio of each to the first; left out where no report has it.
  template <class Figure>
  void figures(const std::string& title, const char* form, const Figure& figure) {
    std::vector<std::optional<double>> values;
    for (const OtherReport* report : reports_) values.push_back(figure(report->figures));
    if (std::ranges::none_of(values, [](const auto& value) { return value.has_value(); })) return;
    text_ += "| " + title + " |";
    for (std::size_t i = 0; i < values.size(); ++i) {
      text_ += " " + or_nothing(values[i], form);
      if (i > 0 && values[i] && values[0] && *values[0] > 0)
        text_ += fmt::format(" (x {:.2f})", *values[i] / *values[0]);
      text_ += " |";
    }
    text_ += "\n";
  }
  const std::string& text() const { return text_; }

 private:
  const std::vector<const OtherReport*>& reports_;
  std::string text_;
};

std::vector<Size> sizes_of_frames(const std::vector<const OtherReport*>& reports) {
  std::vector<Size> sizes;
  for (const OtherReport* report : reports)
    if (const Json* const all = frames(report->figures))
      for (const Json& frame : *all)
        if (std::ranges::find(sizes, size_of(frame)) == sizes.end())
          sizes.push_back(size_of(frame));
  return sizes;
}

std::string protocol_text(const std::vector<const OtherReport*>& reports) {
  std::string text = "\nWhat is inside:\n";
  for (const char* figure : {"step", "frame"})
    for (const OtherReport* report : reports) {
      const Json* const protocol = member(report->figures, "protocol");
      const std::string inside = protocol ? words(*protocol, figure) : "";
      text += fmt::format("- {}, a {}: {}\n", report->name, figure,
                          inside.empty() ? "the file does not say" : inside);
    }
  return text;
}

std::string warnings(const std::vector<const OtherReport*>& reports) {
  std::string text;
  const Json& first = reports.front()->figures;
  for (const OtherReport* report : reports) {
    const auto differ = [&](const char* what) {
      text +=
          fmt::format("- {} has another {} than {}.\n", report->name, what, reports.front()->name);
    };
    if (words(report->figures, "device") != words(first, "device")) differ("device");
    for (const auto& [key, what] :
         {std::pair("num_gaussians", "number of Gaussians"), std::pair("sh_degree", "SH degree")})
      if (number(report->figures, key) != number(first, key)) differ(what);
    if (words(report->figures, "scene") != words(first, "scene")) differ("scene");
  }
  return text.empty() ? "" : "\nCompare with care:\n" + text;
}

}  // namespace

std::vector<OtherReport> read_reports(const std::vector<std::filesystem::path>& files) {
  std::vector<OtherReport> reports;
  for (const std::filesystem::path& file : files) {
    Json figures = read_json(file);
    if (!milliseconds_of_step(figures) && !frames(figures))
      throw Error(fmt::format("{} has no times: neither train.ms_per_step nor render; {}",
                              file.string(), kRemedyOfBenchmarks));
    std::string name = words(figures, "program");
    reports.push_back({name.empty() ? file.stem().string() : std::move(name), std::move(figures)});
  }
  return reports;
}

std::string comparison_text(const OtherReport& own, const std::vector<OtherReport>& others) {
  std::vector<const OtherReport*> reports = {&own};
  for (const OtherReport& other : others) reports.push_back(&other);
  Table table(reports);
  table.row("version", [](const Json& report) { return words(report, "version"); });
  table.row("device", [](const Json& report) { return words(report, "device"); });
  table.row("clock / MHz",
            [](const Json& report) { return or_nothing(number(report, "clock_mhz"), "{:.0f}"); });
  table.row("Gaussians", [](const Json& report) {
    const auto count = number(report, "num_gaussians");
    return count ? with_commas(std::uint64_t(*count)) : "";
  });
  const Size of_step = size_of(own.figures);
  table.figures(fmt::format("training step, {}x{} / ms", of_step.first, of_step.second), "{:.3f}",
                [](const Json& report) { return milliseconds_of_step(report); });
  for (const Size& size : sizes_of_frames(reports))
    table.figures(fmt::format("frame, {}x{} / ms", size.first, size.second), "{:.3f}",
                  [&](const Json& report) { return milliseconds_of_frame(report, size); });
  table.figures("GPU memory of training / MiB", "{:.0f}", [](const Json& report) {
    const auto bytes = number(report, "peak_gpu_bytes");
    return bytes ? std::optional<double>(*bytes / double(1 << 20)) : std::nullopt;
  });
  return table.text() + protocol_text(reports) + warnings(reports);
}

}  // namespace gs
