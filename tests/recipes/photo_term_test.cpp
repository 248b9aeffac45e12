// SPDX-License-Identifier: Apache-2.0
// The recipe "a photo term" of docs/develop/extending.md.
#include <gtest/gtest.h>

#include "gs_train/train_step.h"
#include "tests/support/models.h"
#include "tests/support/scenes.h"

// [recipe]
#include "gs_train/photo_terms/photo_term.h"

namespace gs {
namespace {

// The mean color of the first and the last row of a photo, 0..1.
Vec3f border_color(const Image8& photo) {
  const std::size_t row = 3 * std::size_t(photo.width), last = photo.pixels.size() - row;
  Vec3f sum(0.0f);
  for (std::size_t i = 0; i < row; ++i)
    sum[int(i % 3)] += float(photo.pixels[i]) + float(photo.pixels[last + i]);
  return sum / (2.0f * 255.0f * float(photo.width));
}

/// Renders each photo over the color of its border.
class BackdropTerm final : public PhotoTerm {
 public:
  void prepare(const TrainingModel&, StepPhoto& photo) override {
    photo.settings.background = border_color(photo.view->photo);
  }
};

}  // namespace

std::unique_ptr<PhotoTerm> make_backdrop_term(const std::shared_ptr<const PhotometricModel>&) {
  return std::make_unique<BackdropTerm>();
}

}  // namespace gs
// [end]

namespace gs {
namespace {

TEST(RecipePhotoTerm, RendersEachPhotoOverTheColorOfItsBorder) {
  View views[2];
  for (int i = 0; i < 2; ++i) {
    views[i].camera = random_camera(40, 30);
    views[i].photo = Image8(40, 30, 3, std::uint8_t(51 * i));
  }
  TrainingModel model = model_of(random_gaussians(kTypical, 100, views[0].camera, 1));
  StepStages on;
  on.terms.push_back(make_backdrop_term(nullptr));
  for (int i = 0; i < 2; ++i) {
    const TrainingPhoto photo{&views[i], {}};
    train_step(on, model, {{&photo, 1}, {0.2f}, {}});
    EXPECT_NEAR(on.pass.background.x, 0.2f * float(i), 1e-6f);
  }
}

}  // namespace
}  // namespace gs
