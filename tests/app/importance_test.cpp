// SPDX-License-Identifier: Apache-2.0
// The importance of colors and shapes against finite differences of a picture's sum.
#include "gs_app/export/importance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gs_core/geometry/symmetric_eigen.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

class Importance : public ::testing::Test {
 protected:
  Importance() : one_(1, host_memory()) {
    set_gaussian(one_, 0, {0, 0, 2}, 0.1f, 0.5f);
    one_.log_scale[0] = {-1.8f, -2.3f, -2.9f};
    one_.rotation[0] = {0.8f, 0.3f, -0.4f, 0.35f};
    one_.sh0[0] = Vec3f(0.7f);
    settings_.sh_degree = 0;
    settings_.background = Vec3f(0);
    camera_.cx = camera_.cy = 48;
  }
  /// Of all pixels and channels.
  double sum() const {
    RenderPass pass;
    backend_->renderer().forward(one_.span(), camera_, settings_, pass);
    double sum = 0;
    for (const float value : pass.image.download()) sum += value;
    return sum;
  }
  RowImportance importance() const {
    return importance_of({*backend_, one_.span(), settings_, {}}, one_, {camera_, camera_});
  }
  double pixels() const { return 2.0 * camera_.width * camera_.height; }

  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
  Camera camera_ = plain_camera(96, 96);
  RenderSettings settings_;
  Gaussians one_;
};

// Both views show the same.
TEST_F(Importance, OfAColorIsTheSlopeOfAChannel) {
  const double before = sum(), step = 0.1;
  const double color = importance().color[0];
  one_.sh0[0].y += float(step);
  EXPECT_NEAR(color * pixels(), 2 * (sum() - before) / step, 1e-3 * color * pixels());
}

TEST_F(Importance, OfAShapeIsTheLargestSlopeByTheNormalizedCovariance) {
  const double shape = importance().shape[0];
  const Vec3d v = variance(Vec3d(one_.log_scale[0]));
  const double size = v.x + v.y + v.z, step = 0.01;
  const Sym3<double> middle = covariance(rotation_matrix(in_double(one_.rotation[0])), v / size);
  const auto sum_with = [&](int entry, double change) {
    Sym3<double> sigma = middle;
    (&sigma.xx)[entry] += change;
    const SymmetricEigen axes = symmetric_eigen(sigma);
    for (int k = 0; k < 3; ++k) one_.log_scale[0][k] = float(0.5 * std::log(axes.value[k] * size));
    const Quat<double> q = quaternion_of(axes.R);
    one_.rotation[0] = {float(q.w), float(q.x), float(q.y), float(q.z)};
    return sum();
  };
  double largest = 0;
  for (int entry = 0; entry < 6; ++entry)
    largest =
        std::max(largest, std::abs(sum_with(entry, step) - sum_with(entry, -step)) / (2 * step));
  // Fragments below 1/255 come and go with the shape, which the gradient does not see.
  EXPECT_NEAR(shape * pixels() / (2 * largest), 1, 0.05);
}

}  // namespace
}  // namespace gs
