// SPDX-License-Identifier: Apache-2.0
#include "apps/python/render.h"

#include <pybind11/stl.h>
#include <spdlog/fmt/fmt.h>

#include <optional>

#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/model.h"
#include "apps/python/scene.h"
#include "apps/python/settings.h"
#include "data_loaders/cameras/camera_file.h"
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

struct Picture {
  py::object color, alpha, depth, normals;
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

// The config to render with: that of the model, changed by `settings`.
Config looking_config(const Model& model, const py::object& settings) {
  Config config = model.config;
  merge_settings(config, settings);
  validate(config);
  return config;
}

RenderSettings settings_for(const Model& model, const py::object& settings,
                            const py::object& background) {
  Config config = looking_config(model, settings);
  const bool is_word = py::isinstance<py::str>(background);
  if (is_word) apply_setting(config, "render.background=" + background.cast<std::string>());
  validate(config);
  RenderSettings result = view_settings(model, config);
  if (!background.is_none() && !is_word)
    result.background = Vec3f(vector_of("background", background));
  return result;
}

Picture picture_of(Frame frame) {
  const auto array_or_none = [](ImageF image) {
    return image.empty() ? py::object(py::none()) : py::object(array_of(std::move(image)));
  };
  return {array_of(std::move(frame.color)), array_of(std::move(frame.alpha)),
          array_or_none(std::move(frame.depth)), array_or_none(std::move(frame.normals))};
}

py::object render(const Model& model, const py::object& camera, const py::object& background,
                  const std::string& device, bool depth, bool normals, const py::object& config) {
  const bool is_one = py::isinstance<NamedCamera>(camera);
  std::vector<NamedCamera> cameras;
  if (is_one)
    cameras.push_back(camera.cast<NamedCamera>());
  else
    for (const py::handle& one : camera) cameras.push_back(one.cast<NamedCamera>());
  const RenderSettings settings = settings_for(model, config, background);
  std::vector<Frame> frames;
  {
    const py::gil_scoped_release release;
    frames = render_frames(model, cameras, settings, device, {depth, normals});
  }
  py::list pictures;
  for (Frame& frame : frames) pictures.append(picture_of(std::move(frame)));
  return is_one ? py::object(pictures[0]) : pictures;
}

Evaluation evaluate_views(const Model& model, const LoadedScene& scene, const std::string& split,
                          const std::string& device, const py::object& config) {
  if (split != "test" && split != "train")
    throw UsageError("there is no split " + split + "; there are test and train");
  if (model.model.world_offset != scene.scene.world_offset)
    throw UsageError(
        "the model and the scene have different world offsets; load the scene that the model was "
        "trained on");
  const RenderSettings settings = settings_for(model, config, py::none());
  const EvalConfig eval = looking_config(model, config).eval;
  const std::vector<View>& views =
      split == "test" ? scene.scene.test_views : scene.scene.train_views;
  const py::gil_scoped_release release;
  const std::unique_ptr<Lpips> lpips = make_lpips(eval);
  if (lpips) lpips->check_sizes(views);
  const Work work;
  const BorrowedBackend backend(device);
  const OnDevice gaussians(model, backend->memory());
  const std::unique_ptr<PackedScene> packed = backend->renderer().pack(gaussians.span(), settings);
  return evaluate(backend->renderer(), *packed, views, settings, {}, MetricSet{true, lpips.get()});
}

// The metrics of a view, or the means over views; 0 when there are no views.
template <class Metrics>
void bind_perceptual(py::class_<Metrics>& type) {
  const auto of = [](const Metrics& self) { return self.perceptual.value_or(PerceptualMetrics()); };
  type.def_property_readonly(
      "flip", [of](const Metrics& self) { return of(self).flip; },
      "0 to 1, lower is better: the difference that an observer sees (Andersson et al. 2020).");
  type.def_property_readonly(
      "lpips", [of](const Metrics& self) { return of(self).lpips; },
      "Lower is better: the distance of a network's features (Zhang et al. 2018), where the "
      "setting "
      "eval.lpips names the file of its weights; else None.");
}

void bind_evaluation(py::module_& module) {
  py::class_<ViewMetrics> view(module, "ViewMetrics",
                               "PSNR, SSIM, FLIP and LPIPS of one view against its photo.");
  view.def_readonly("name", &ViewMetrics::name, "The photo's name.");
  view.def_readonly("psnr", &ViewMetrics::psnr, "dB; 100 if no pixel differs.");
  view.def_readonly("ssim", &ViewMetrics::ssim, "0 to 1.");
  bind_perceptual(view);
  py::class_<Evaluation> evaluation(
      module, "Evaluation",
      "Renders compared with photos, as in the papers: means over views, and each view.");
  evaluation.def_readonly("psnr", &Evaluation::psnr, "dB, the mean over views.");
  evaluation.def_readonly("ssim", &Evaluation::ssim, "0 to 1, the mean over views.");
  bind_perceptual(evaluation);
  evaluation.def_readonly("views", &Evaluation::views, "List of ViewMetrics.");
  evaluation.def("__repr__", [](const Evaluation& self) {
    return fmt::format("<gemsplat.Evaluation: {:.2f} dB PSNR, {:.4f} SSIM over {} views>",
                       self.psnr, self.ssim, self.views.size());
  });
  module.def("evaluate", evaluate_views, py::arg("model"), py::arg("scene"), py::kw_only(),
             py::arg("split") = "test", py::arg("device") = "auto", py::arg("config") = py::none(),
             "Renders the scene's test (or train) views and compares them with their photos. "
             "config={\"eval.lpips\": FILE} adds LPIPS.");
}

}  // namespace

void bind_render(py::module_& module) {
  py::class_<Picture> picture(module, "Picture",
                              "The result of render(): float32 arrays that own their memory.");
  picture.def_readonly(
      "color", &Picture::color,
      "(height, width, 3): red green blue over the background, 0 to 1, sRGB as displayed.");
  picture.def_readonly("alpha", &Picture::alpha,
                       "(height, width): how much of a pixel the Gaussians cover, 0 to 1.");
  picture.def_readonly(
      "depth", &Picture::depth,
      R"((height, width): mean distance of the visible Gaussians along the viewing axis, world units, with
the weights of the colors; 0 where alpha is close to 0. None unless depth=True.)");
  picture.def_readonly(
      "normals", &Picture::normals,
      R"((height, width, 3): normals of the surface given by the depth, in world space, of length 1, towards
the camera; 0 where there is no depth. None unless normals=True.)");
  module.def(
      "render", render, py::arg("model"), py::arg("camera"), py::kw_only(),
      py::arg("background") = py::none(), py::arg("device") = "auto", py::arg("depth") = true,
      py::arg("normals") = false, py::arg("config") = py::none(),
      R"(Renders a Picture of the model from a Camera, or a list of them from an iterable of cameras; a GPU
then gets the model only once. background: "black", "white" or three numbers 0 to 1; else the model's. device: auto,
cpu, cuda, cuda:N. Depth, and normals from it, take another pass like that of color and alpha. config:
settings of [render] and [model] over the model's own, as train() takes them. Several threads may
render; on one device they take turns.)");
  bind_evaluation(module);
}

}  // namespace gs::python
