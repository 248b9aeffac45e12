// SPDX-License-Identifier: Apache-2.0
#include <pybind11/stl.h>

#include <array>
#include <optional>

#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/module.h"
#include "data_loaders/cameras/camera_file.h"
#include "gs_app/jobs/keywords.h"
#include "gs_core/error.h"
#include "gs_eval/lpips/lpips.h"
#include "gs_eval/metrics.h"
#include "gs_render/surface_renderer.h"

namespace gs::python {
namespace {

/// What is asked for besides color and alpha.
struct Wanted {
  bool depth, normals;
};

struct Frame {
  ImageF color, alpha, depth, normals;  // the last two empty where they are not wanted
};

// The model in a backend's memory: where it lies, or a copy.
class OnDevice {
 public:
  OnDevice(const Model& model, Memory& memory) : span_(model.model.gaussians.span()) {
    if (&memory == &host_memory()) return;
    copy_ = copy_to(memory, model.model);
    span_ = copy_->span();
  }
  const GaussiansSpan& span() const { return span_; }

 private:
  GaussiansSpan span_;
  std::optional<Gaussians> copy_;
};

std::vector<Frame> render_frames(const Model& model, const std::vector<NamedCamera>& cameras,
                                 const RenderSettings& settings, const std::string& device,
                                 const Wanted& wanted) {
  const Work work;
  const BorrowedBackend backend(device);
  const OnDevice gaussians(model, backend->memory());
  Renderer& renderer = backend->renderer();
  const std::unique_ptr<PackedScene> packed = renderer.pack(gaussians.span(), settings);
  RenderPass pass(backend->memory());
  std::optional<SurfaceRenderer> surface;
  if (wanted.depth || wanted.normals)
    surface.emplace(renderer, gaussians.span(), model.model.gaussians, settings);
  std::vector<Frame> frames;
  for (const NamedCamera& named : cameras) {
    renderer.draw(*packed, named.camera, settings, pass);
    Frame& frame = frames.emplace_back(Frame{image_of(pass), alpha_of(pass), {}, {}});
    if (surface) frame.depth = surface->depth(named.camera);
    if (wanted.normals) frame.normals = normals_of(frame.depth, named.camera);
    if (!wanted.depth) frame.depth = {};
  }
  return frames;
}

// The config to render with: that of the model, changed by `settings` and keywords.
Config looking_config(const Model& model, const std::string& settings, const FilledVerb& keywords) {
  Config config = model.config;
  apply_settings(config, Json::parse(settings));
  keywords.apply_to(config);
  validate(config);
  return config;
}

py::object array_or_none(ImageF image) {
  return image.empty() ? py::object(py::none()) : py::object(array_of(std::move(image)));
}

// [(color, alpha, depth, normals) of each camera]; the last two are None where they are not wanted.
py::list render(const Model& model, const std::vector<NamedCamera>& cameras,
                const std::optional<std::array<double, 3>>& background, bool depth, bool normals,
                const std::string& settings, const std::string& values) {
  const FilledVerb keywords("render", Json::parse(values));
  RenderSettings looks = view_settings(model, looking_config(model, settings, keywords));
  if (const auto& b = background) looks.background = Vec3f(Vec3d{(*b)[0], (*b)[1], (*b)[2]});
  std::vector<Frame> frames;
  {
    const py::gil_scoped_release release;
    frames = render_frames(model, cameras, looks, keywords.device(), {depth, normals});
  }
  py::list pictures;
  for (Frame& frame : frames)
    pictures.append(py::make_tuple(
        array_of(std::move(frame.color)), array_of(std::move(frame.alpha)),
        array_or_none(std::move(frame.depth)), array_or_none(std::move(frame.normals))));
  return pictures;
}

py::tuple evaluate_views(const Model& model, const LoadedScene& scene, const std::string& settings,
                         const std::string& values) {
  const FilledVerb keywords("eval", Json::parse(values));
  const std::string& split = keywords.get<std::string>("--split");
  if (split == "all") throw UsageError("split takes test or train, and not all");
  if (model.model.world_offset != scene.scene.world_offset)
    throw UsageError(
        "the model and the scene have different world offsets; load the scene that the model was "
        "trained on");
  const Config config = looking_config(model, settings, keywords);
  const RenderSettings looks = view_settings(model, config);
  const std::vector<View>& views =
      split == "test" ? scene.scene.test_views : scene.scene.train_views;
  const auto measured = [&] {
    const py::gil_scoped_release release;
    const std::unique_ptr<Lpips> lpips = make_lpips(config.eval);
    if (lpips) lpips->check_sizes(views);
    const Work work;
    const BorrowedBackend backend(keywords.device());
    const OnDevice gaussians(model, backend->memory());
    const std::unique_ptr<PackedScene> packed = backend->renderer().pack(gaussians.span(), looks);
    return evaluate(backend->renderer(), *packed, views, looks, {}, MetricSet{true, lpips.get()});
  };
  return figures_of(measured());
}

}  // namespace

py::tuple figures_of(const Evaluation& evaluation) {
  py::list views;
  for (const ViewMetrics& view : evaluation.views) {
    const PerceptualMetrics seen = view.perceptual.value_or(PerceptualMetrics());
    views.append(py::make_tuple(view.name, view.psnr, view.ssim, seen.flip, seen.lpips));
  }
  const PerceptualMetrics seen = evaluation.perceptual.value_or(PerceptualMetrics());
  return py::make_tuple(evaluation.psnr, evaluation.ssim, seen.flip, seen.lpips, views);
}

void bind_render(py::module_& module) {
  module.def("render", render);
  module.def("evaluate", evaluate_views);
}

}  // namespace gs::python
