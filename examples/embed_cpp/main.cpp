// SPDX-License-Identifier: Apache-2.0
// gemsplat in a program of your own: trains on a scene, and writes the model and a picture of it.
//   gemsplat_example SCENE STEPS OUT
#include <cstdio>
#include <filesystem>
#include <string>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_app/run/make_backend.h"
#include "gs_core/error.h"
#include "gs_eval/metrics.h"
#include "gs_model/formats/formats.h"
#include "gs_train/loop/trainer.h"

namespace {

// Prints the loss every ten steps. An observer may also stop the run (trainer.stop()), and take a
// copy of the model (trained_model(trainer)).
class Printer final : public gs::Observer {
 public:
  void after_step(int step, gs::Trainer& trainer) override {
    if (step % 10 == 0)
      std::printf("step %d: loss %.4f, %zu Gaussians\n", step, trainer.loss(),
                  trainer.gaussian_count());
  }
};

void write_picture(gs::Trainer& trainer, const gs::Camera& camera,
                   const std::filesystem::path& file) {
  gs::Renderer& renderer = trainer.backend().renderer();
  gs::RenderPass pass(renderer.memory());
  renderer.forward(trainer.model().gaussians.span(), camera, trainer.evaluation_settings(), pass);
  gs::write_png(file, gs::to_image8(gs::image_of(pass)));
}

void run(const std::string& source, int steps, const std::filesystem::path& out) {
  gs::Config config;  // or load_config(config, "mcmc"), a TOML file, the folder of a run
  config.dataset.source = source;
  config.dataset.eval = true;
  config.dataset.resolution = 4;
  config.train.iterations = steps;
  gs::validate(config);

  const auto backend = gs::make_backend("auto");
  const gs::Scene scene = gs::load_scene(config.dataset);
  gs::Trainer trainer(scene, config, *backend);
  Printer printer;
  trainer.add_observer(printer);
  trainer.run();

  const gs::Evaluation test = gs::evaluate(backend->renderer(), trainer.model().gaussians.span(),
                                           scene.test_views, trainer.evaluation_settings());
  std::printf("%.2f dB PSNR on %zu held-out views\n", test.psnr, test.views.size());
  const gs::GaussianModel model = gs::trained_model(trainer);
  gs::write_model(out / "model.ply", model);
  gs::write_model(out / "model.spz", model);
  write_picture(trainer, scene.test_views.at(0).camera, out / "view.png");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: gemsplat_example SCENE STEPS OUT\n");
    return 2;
  }
  try {
    run(argv[1], std::stoi(argv[2]), argv[3]);
  } catch (const gs::Error& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return int(error.code());
  }
}
