// SPDX-License-Identifier: Apache-2.0
// Changes that must not change a picture: another order of the Gaussians in memory, and additional
// Gaussians that no pixel shows.
#include "gs_train/backend.h"
#include "tests/support/models.h"

namespace gs {
namespace {

class Invariance : public ::testing::Test {
 protected:
  const Camera camera_ = random_camera(120, 80);
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();

  /// Picture and transmittance.
  std::pair<std::vector<float>, std::vector<float>> render(const Gaussians& gaussians,
                                                           const RenderSettings& settings = {}) {
    RenderPass pass;
    backend_->renderer().forward(gaussians.span(), camera_, settings, pass);
    return {pass.image.download(), pass.transmittance.download()};
  }
};

// Random depths are distinct (Gaussians behind the camera do not count), so blending has only one
// order.
TEST_F(Invariance, PermutingTheGaussiansLeavesEachBitOfThePicture) {
  const Gaussians gaussians = mixed_gaussians(200, camera_, 1);
  const auto before = render(gaussians);
  for (const std::uint64_t seed : {1, 2, 3})
    EXPECT_EQ(render(rows_of(gaussians, random_permutation(gaussians.count(), seed))), before);
}

TEST_F(Invariance, PermutingTheGaussiansPermutesTheirGradients) {
  const Gaussians gaussians = mixed_gaussians(100, camera_, 2);
  const std::vector<std::uint32_t> order = random_permutation(gaussians.count(), 4);
  const Gaussians permuted = rows_of(gaussians, order);
  Buffer<float> dL_dimage(3 * std::size_t(120) * 80, host_memory());
  Draws draws(5);
  for (float& weight : dL_dimage) weight = draws.uniform(-1, 1);
  const auto gradients_of = [&](const Gaussians& rows) {
    RenderPass pass;
    Gaussians gradients(rows.count(), host_memory());
    Buffer<Vec2f> dL_dmean2d(rows.count(), host_memory());
    backend_->renderer().forward(rows.span(), camera_, {}, pass);
    backend_->renderer().backward(rows.span(), camera_, {}, pass, dL_dimage.span(),
                                  gradients.span(), dL_dmean2d.span());
    return gradients;
  };
  EXPECT_TRUE(same_bits(rows_of(gradients_of(gaussians), order), gradients_of(permuted)));
}

TEST_F(Invariance, PruningWhatIsTooFaintLeavesEachBitOfThePicture) {
  for (const bool antialias : {false, true}) {
    RenderSettings settings;
    settings.antialias = antialias;
    TrainingModel model = model_of(mixed_gaussians(200, camera_, 4));
    for (std::size_t i = 0; i < model.count(); i += 10) model.gaussians.rotation[i] = {0, 0, 0, 0};
    const auto before = render(model.gaussians, settings);
    EXPECT_GT(backend_->rows().prune(model, kMinAlpha), 200u);
    EXPECT_EQ(render(model.gaussians, settings), before);
  }
}

// More tiles list a splat than it hits; in the additional ones it has no fragment.
TEST_F(Invariance, ListingTheWholeBoundingBoxLeavesEachBitOfThePicture) {
  const Gaussians gaussians = mixed_gaussians(200, camera_, 6);
  RenderSettings box;
  box.bounds = TileBounds::box;
  EXPECT_EQ(render(gaussians, box), render(gaussians));
}

// The square of three standard deviations drops fragments with alpha >= 1/255 beyond it: at most
// exp(-4.5) of a splat.
TEST_F(Invariance, ListingTheSquareOf3SigmaChangesThePictureLittle) {
  const Gaussians gaussians = mixed_gaussians(200, camera_, 7);
  RenderSettings square;
  square.bounds = TileBounds::square;
  const auto [image, transmittance] = render(gaussians, square);
  const auto exact = render(gaussians).first;
  double sum = 0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    EXPECT_NEAR(image[i], exact[i], 0.05f);
    sum += std::abs(double(image[i]) - exact[i]);
  }
  EXPECT_LT(sum / double(image.size()), 1e-3);
}

}  // namespace
}  // namespace gs
