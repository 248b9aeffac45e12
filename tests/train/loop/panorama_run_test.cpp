// SPDX-License-Identifier: Apache-2.0
// A run on panoramas of 360 degrees of a room.
#include "tests/support/load_scene.h"
#include "tests/support/room.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

TEST_F(SceneTest, PanoramasOfARoomTrain) {
  constexpr int kWidth = 96;
  const ColmapModel model = room_model(12, kWidth);
  write(model);
  for (const ColmapImage& image : model.images)
    write_png(this->image(image.name), room_photo(image, kWidth));
  DatasetConfig dataset = this->dataset();
  dataset.eval = true;
  dataset.test_every = 6;
  const Scene scene = load_scene(dataset);
  ASSERT_EQ(scene.test_views.size(), 4u);
  Config config = short_run();
  config.train.iterations = 500;
  config.density.until_step = 0;
  const std::unique_ptr<Backend> backend = make_scalar_backend();
  Trainer trainer(scene, config, *backend);
  EXPECT_LT(psnr_of(*backend, trainer, scene.test_views), 15);
  trainer.run();
  EXPECT_EQ(backend->rows().count_not_finite(trainer.model()), 0u);
  EXPECT_GT(psnr_of(*backend, trainer, scene.test_views), 24);  // 25.7 at the time of writing
  const Evaluation measured = evaluate(backend->renderer(), trainer.model().gaussians.span(),
                                       scene.test_views, {}, {}, MetricSet::all);
  ASSERT_TRUE(measured.panorama);
  EXPECT_FALSE(measured.views[0].panorama);  // the half behind
  ASSERT_TRUE(measured.views[1].panorama);
  EXPECT_NEAR(measured.panorama->psnr, measured.psnr, 1);
  EXPECT_NEAR(measured.panorama->ws_psnr, measured.psnr, 1);
  EXPECT_NEAR(measured.panorama->ssim, measured.ssim, 0.1);
}

}  // namespace
}  // namespace gs
