// SPDX-License-Identifier: Apache-2.0
// ModelInfo for people and for machines.
#include <spdlog/fmt/fmt.h>

#include "gs_core/system/text/json.h"
#include "gs_model/formats/model_info.h"

namespace gs {
namespace {

std::string text_of(const Vec3f& v) { return fmt::format("{:.4g} {:.4g} {:.4g}", v.x, v.y, v.z); }
FloatJson json_of(const Vec3f& v) { return FloatJson::array({v.x, v.y, v.z}); }

}  // namespace

std::string describe(const ModelInfo& info) {
  std::string text = fmt::format("Gaussians:     {}\n", info.count);
  text += fmt::format("SH degree:     {}\n", info.sh_degree);
  text += fmt::format("antialiased:   {}\n", info.antialiased ? "yes" : "no");
  if (info.had_filter_3d)
    text += "3D filter:     Mip-Splatting's filter_3D, applied to scales and opacities\n";
  text += fmt::format("in memory:     {:.1f} MiB\n", double(info.bytes) / (1 << 20));
  text += fmt::format("bounds:        {}  to  {}\n", text_of(info.min), text_of(info.max));
  text +=
      fmt::format("98 % on axes:  {}  to  {}\n", text_of(info.inner_min), text_of(info.inner_max));
  text += fmt::format("median scale:  {:.4g}\n", info.median_scale);
  text +=
      fmt::format("opacity:       {:.1f} % below 1/255, {:.1f} % below 0.05, {:.1f} % above 0.9\n",
                  100 * info.faint_share, 100 * info.thin_share, 100 * info.solid_share);
  if (info.has_time)
    text += fmt::format("in time:       yes; median scale {:.3g} of the scene's duration\n",
                        info.median_time_scale);
  for (const Suspicion& suspicion : info.suspicions) {
    text += fmt::format("suspicious:    {}\n", suspicion.sentence);
  }
  if (info.suspicions.empty()) text += "suspicious:    nothing\n";
  return text;
}

std::string to_json_text(const ModelInfo& info) {
  FloatJson json;
  json["count"] = info.count;
  json["sh_degree"] = info.sh_degree;
  json["antialiased"] = info.antialiased;
  json["had_filter_3d"] = info.had_filter_3d;
  json["bytes"] = info.bytes;
  json["min"] = json_of(info.min);
  json["max"] = json_of(info.max);
  json["percentile_1"] = json_of(info.inner_min);
  json["percentile_99"] = json_of(info.inner_max);
  json["median_scale"] = info.median_scale;
  json["opacity_below_1_255"] = info.faint_share;
  json["opacity_below_0_05"] = info.thin_share;
  json["opacity_above_0_9"] = info.solid_share;
  if (info.has_time) json["median_time_scale"] = info.median_time_scale;
  json["suspicions"] = FloatJson::object();
  for (const Suspicion& suspicion : info.suspicions)
    json["suspicions"][suspicion.key] = suspicion.count;
  return json.dump();
}

}  // namespace gs
