// SPDX-License-Identifier: Apache-2.0
// Models of arrays: checked and copied.
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <cstring>

#include "apps/python/arrays.h"
#include "apps/python/model.h"
#include "gs_core/error.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/rotation.h"

namespace gs::python {
namespace {

template <class T>
void copy_rows(const FloatArray& from, const Buffer<T>& to) {
  if (from.size()) std::memcpy(to.data(), from.data(), std::size_t(from.size()) * sizeof(float));
}

// The array in its stored form. If the activated form is given, `stored` converts each value.
template <class F>
FloatArray stored_values(const char* stored_name, const py::object& stored, const char* name,
                         const py::object& activated, const Shape& shape, F&& stored_of) {
  if (stored.is_none() == activated.is_none())
    throw UsageError(fmt::format("give either {} or {}", name, stored_name));
  if (!stored.is_none()) return floats_of(stored_name, stored, shape);
  const FloatArray values = floats_of(name, activated, shape);
  FloatArray result(Shape(values.shape(), values.shape() + values.ndim()));
  for (py::ssize_t i = 0; i < values.size(); ++i)
    result.mutable_data()[i] = stored_of(values.data()[i]);
  return result;
}

float log_of(float scale) {
  if (!(scale > 0)) throw UsageError(fmt::format("scales must be above 0, and one is {}", scale));
  return std::log(scale);
}

float logit_of(float opacity) {
  if (!(opacity > 0 && opacity < 1))
    throw UsageError(
        fmt::format("opacities must lie between 0 and 1, both excluded, and one is {}", opacity));
  return logit(opacity);
}

void copy_rotations(const FloatArray& rotations, const Gaussians& to) {
  copy_rows(rotations, to.rotation);
  for (std::size_t i = 0; i < to.count(); ++i)
    if (is_degenerate(to.rotation[i]))
      throw UsageError(fmt::format("rotations holds a quaternion of length 0 in row {}", i));
}

// (N, K, 3) into rows of 15 coefficients; returns the SH degree.
int copy_sh_rest(const py::object& value, Gaussians& to) {
  to.sh_rest.fill_zero();
  if (value.is_none()) return 0;
  const auto count = py::ssize_t(to.count());
  const FloatArray array = floats_of("sh_rest", value, {count, kAny, 3});
  for (int degree = 0; degree <= kMaxShDegree; ++degree) {
    const auto coefficients = sh_rest_count(degree);
    if (array.shape(1) != coefficients) continue;
    for (py::ssize_t i = 0; i < count && coefficients; ++i)
      std::memcpy(to.sh_rest.data() + i, array.data(i, 0, 0),
                  std::size_t(coefficients) * sizeof(Vec3f));
    return degree;
  }
  throw UsageError(
      fmt::format("sh_rest must have 0, 3, 8 or 15 coefficients (SH degree 0 to 3), and has {}",
                  array.shape(1)));
}

}  // namespace

std::shared_ptr<Model> make_model(const ModelArrays& arrays, bool antialiased,
                                  const py::object& world_offset) {
  const FloatArray means = floats_of("means", arrays.means, {kAny, 3});
  const py::ssize_t count = means.shape(0);
  auto model = std::make_shared<Model>();
  Gaussians& gaussians = model->model.gaussians;
  gaussians.resize(std::size_t(count));
  copy_rows(means, gaussians.mean);
  copy_rotations(floats_of("rotations", arrays.rotations, {count, 4}), gaussians);
  copy_rows(
      stored_values("log_scales", arrays.log_scales, "scales", arrays.scales, {count, 3}, log_of),
      gaussians.log_scale);
  copy_rows(stored_values("logit_opacities", arrays.logit_opacities, "opacities", arrays.opacities,
                          {count}, logit_of),
            gaussians.logit_opacity);
  const auto sh0_of = [](float color) { return (color - float(kColorOffset)) / float(kSh0); };
  copy_rows(stored_values("sh0", arrays.sh0, "colors", arrays.colors, {count, 3}, sh0_of),
            gaussians.sh0);
  model->model.sh_degree = copy_sh_rest(arrays.sh_rest, gaussians);
  model->model.antialiased = model->config.render.antialias = antialiased;
  model->config.model.sh_degree = model->model.sh_degree;
  if (!world_offset.is_none()) model->model.world_offset = vector_of("world_offset", world_offset);
  return model;
}

}  // namespace gs::python
