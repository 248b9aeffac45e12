// SPDX-License-Identifier: Apache-2.0
// Times one training step on the CPU, stage by stage, on generated scenes. docs/lab/2026-11-cpu.md
// has its figures, with the machine.
//   per_MP     time per million pixels
//   per_100k   time per 100,000 visible Gaussians
//   tiles      instances per visible Gaussian
#include <benchmark/benchmark.h>

#include "gs_train/backend.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"

namespace gs {
namespace {

constexpr Recipe kSpread{.sigma_low = 0.5f, .sigma_high = 4, .stretch = 4, .reach = 1};
constexpr LearningRates kNoRates{};  // with rates of 0 the scene does not change
constexpr LossSettings kLossSettings{.lambda_dssim = 0.2f};

/// A scene of a given number of Gaussians and picture size, rendered and differentiated once.
struct BenchScene {
  explicit BenchScene(const benchmark::State& state)
      : view{"", random_camera(int(state.range(1)), int(state.range(2))), {}},
        model(model_of(random_gaussians(kSpread, std::size_t(state.range(0)), view.camera, 1))),
        gradients(model.count(), host_memory()), dL_dmean2d(model.count(), host_memory()) {
    view.photo = random_photo(view.camera.width, view.camera.height, 2);
    backend->rows().sort_by_morton(model);  // the order that training keeps
    forward();
    loss();
    backward();
  }
  void forward() {
    backend->renderer().forward(model.gaussians.span(), view.camera, settings, pass);
  }
  void loss() { backend->loss().forward_backward(pass, view, kLossSettings, dL_dimage); }
  void backward() {
    backend->renderer().backward(model.gaussians.span(), view.camera, settings, pass,
                                 dL_dimage.span(), gradients.span(), dL_dmean2d.span());
  }
  void adam() { update_by_adam(model, gradients, {kNoRates}); }
  void step() { backend->step(model, view, settings, kLossSettings, kNoRates, {true}); }

  std::unique_ptr<Backend> backend = make_scalar_backend();
  View view;
  RenderSettings settings;
  TrainingModel model;
  RenderPass pass;
  Buffer<float> dL_dimage;
  Gaussians gradients;
  Buffer<Vec2f> dL_dmean2d;
};

void measure(benchmark::State& state, void (BenchScene::*stage)()) {
  BenchScene scene(state);
  for (auto _ : state) (scene.*stage)();
  using benchmark::Counter;
  const auto time_per = [](double units) {
    return Counter(units, Counter::kIsIterationInvariantRate | Counter::kInvert);
  };
  const double visible = double(scene.pass.depth_order.size());
  state.counters["per_MP"] = time_per(double(scene.pass.pixel_count()) / 1e6);
  state.counters["per_100k"] = time_per(visible / 1e5);
  state.counters["tiles"] = double(scene.pass.tile_splats.size()) / visible;
}

void sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"gaussians", "width", "height"})
      ->Unit(benchmark::kMillisecond)
      ->UseRealTime();
  for (const int gaussians : {10'000, 100'000}) {
    benchmark->Args({gaussians, 320, 240});
    benchmark->Args({gaussians, 1280, 720});
  }
}
BENCHMARK_CAPTURE(measure, forward, &BenchScene::forward)->Apply(sizes);
BENCHMARK_CAPTURE(measure, backward, &BenchScene::backward)->Apply(sizes);
BENCHMARK_CAPTURE(measure, loss, &BenchScene::loss)->Apply(sizes);
BENCHMARK_CAPTURE(measure, adam, &BenchScene::adam)->Apply(sizes);
BENCHMARK_CAPTURE(measure, step, &BenchScene::step)->Apply(sizes);

}  // namespace
}  // namespace gs
