// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/splat.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"

namespace gs {
namespace {

struct Row {
  Vec3f mean, scale;
  std::uint8_t color[4];     // r g b a
  std::uint8_t rotation[4];  // w x y z
};
static_assert(sizeof(Row) == 32);

std::uint8_t rotation_byte(float component) {
  return std::uint8_t(rounded(component * 128 + 128, 255));
}
float component_of(std::uint8_t byte) { return (float(byte) - 128) / 128; }

Row row_of(const Gaussians& g, std::size_t i) {
  const Vec3f &s = g.log_scale[i], &f = g.sh0[i];
  const Quatf& q = g.rotation[i];
  const auto color = [](float sh0) { return std::uint8_t(to_unorm(color_of_sh0(sh0), 8)); };
  return {g.mean[i],
          {finite_exp(s.x), finite_exp(s.y), finite_exp(s.z)},
          {color(f.x), color(f.y), color(f.z), std::uint8_t(opacity_byte(g.logit_opacity[i]))},
          {rotation_byte(q.w), rotation_byte(q.x), rotation_byte(q.y), rotation_byte(q.z)}};
}

void take_row(const Gaussians& g, std::size_t i, const Row& row) {
  const auto sh0 = [&](int channel) { return sh0_of_color(from_unorm(row.color[channel], 8)); };
  const auto& r = row.rotation;
  g.mean[i] = row.mean;
  g.log_scale[i] = log_of_scale(row.scale);
  g.sh0[i] = {sh0(0), sh0(1), sh0(2)};
  g.logit_opacity[i] = logit_of_byte(row.color[3]);
  g.rotation[i] = {component_of(r[0]), component_of(r[1]), component_of(r[2]), component_of(r[3])};
  normalize(&g.rotation[i].w);
}

std::vector<std::size_t> by_importance(const Gaussians& g) {
  std::vector<float> importance(g.count());  // log of volume times opacity, plus a constant
  for (std::size_t i = 0; i < g.count(); ++i) {
    const Vec3f& s = g.log_scale[i];
    importance[i] = s.x + s.y + s.z + std::log(sigmoid(g.logit_opacity[i]));
  }
  std::vector<std::size_t> order(g.count());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return importance[a] > importance[b]; });
  return order;
}

}  // namespace

GaussianModel read_splat(const std::filesystem::path& path) {
  ByteReader reader(path);
  if (reader.size() == 0) cannot_read(path, "it is empty; copy or export it again");
  if (reader.size() % sizeof(Row) != 0)
    cannot_read(path,
                fmt::format("its {} bytes are not a multiple of the 32 that a Gaussian takes; the "
                            "file is cut short or not a .splat, copy or export it again",
                            reader.size()));
  const std::size_t count = reader.size() / sizeof(Row);
  GaussianModel model{Gaussians(count, host_memory()), 0, false, false};
  model.gaussians.sh_rest.fill_zero();
  for (std::size_t i = 0; i < count; ++i)
    take_row(model.gaussians, i, load_little<Row>(reader.take(sizeof(Row))));
  return model;
}

void write_splat(ByteSink& sink, const GaussianModel& model) {
  std::vector<Row> rows;
  rows.reserve(model.gaussians.count());
  for (const std::size_t i : by_importance(model.gaussians))
    rows.push_back(row_of(model.gaussians, i));
  sink.write(rows.data(), rows.size() * sizeof(Row));
}

}  // namespace gs
