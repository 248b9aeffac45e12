// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/lpips/lpips_weights.h"

#include <spdlog/fmt/fmt.h>

namespace gs {
namespace {

const std::string kRemedy =
    "make it with the lines of Python in docs/method/equations.md, under LPIPS, or measure without "
    "it (--lpips none)";

struct ConvolutionPlan {
  const char* name;  // behind "net."
  int kernel, stride, padding;
};
struct StagePlan {
  int pool;
  std::vector<ConvolutionPlan> convolutions;
};
struct NetworkPlan {
  const char *name, *own_layer;  // the latter only this network has
  std::vector<StagePlan> stages;
};

// The layers of torchvision's networks up to the last feature that LPIPS looks at. Numbers in the
// names count layers, also those without weights.
const NetworkPlan kNetworks[] = {
    {"alex",  // Krizhevsky 2014: "One weird trick for parallelizing convolutional neural networks"
     "slice2.3",
     {{0, {{"slice1.0", 11, 4, 2}}},
      {3, {{"slice2.3", 5, 1, 2}}},
      {3, {{"slice3.6", 3, 1, 1}}},
      {0, {{"slice4.8", 3, 1, 1}}},
      {0, {{"slice5.10", 3, 1, 1}}}}},
    {"vgg",  // Simonyan and Zisserman 2015, configuration D
     "slice1.2",
     {{0, {{"slice1.0", 3, 1, 1}, {"slice1.2", 3, 1, 1}}},
      {2, {{"slice2.5", 3, 1, 1}, {"slice2.7", 3, 1, 1}}},
      {2, {{"slice3.10", 3, 1, 1}, {"slice3.12", 3, 1, 1}, {"slice3.14", 3, 1, 1}}},
      {2, {{"slice4.17", 3, 1, 1}, {"slice4.19", 3, 1, 1}, {"slice4.21", 3, 1, 1}}},
      {2, {{"slice5.24", 3, 1, 1}, {"slice5.26", 3, 1, 1}, {"slice5.28", 3, 1, 1}}}}},
};

using Shape = std::vector<std::int64_t>;

std::string text_of(const Shape& shape) { return fmt::format("({})", fmt::join(shape, ", ")); }

// A number in `wanted` that is 0 may be any but 0.
FloatArray array_of(const SafetensorsFile& file, const std::string& name, const Shape& wanted) {
  FloatArray array = file.array(name);
  bool fits = array.shape.size() == wanted.size();
  for (std::size_t i = 0; fits && i < wanted.size(); ++i)
    fits = array.shape[i] > 0 && (wanted[i] == 0 || array.shape[i] == wanted[i]);
  if (!fits)
    file.refuse(fmt::format("{} has the shape {} and not {}, where 0 stands for any", name,
                            text_of(array.shape), text_of(wanted)));
  return array;
}

Convolution convolution_of(const SafetensorsFile& file, const ConvolutionPlan& plan, int inputs) {
  const std::string name = std::string("net.") + plan.name;
  Convolution layer;
  layer.weights = array_of(file, name + ".weight", {0, inputs, plan.kernel, plan.kernel});
  layer.bias = array_of(file, name + ".bias", {layer.outputs()});
  layer.stride = plan.stride;
  layer.padding = plan.padding;
  return layer;
}

FeatureStage stage_of(const SafetensorsFile& file, const StagePlan& plan, int inputs) {
  FeatureStage stage{plan.pool, {}};
  for (const ConvolutionPlan& convolution : plan.convolutions) {
    stage.convolutions.push_back(convolution_of(file, convolution, inputs));
    inputs = stage.convolutions.back().outputs();
  }
  return stage;
}

// Without dropout in training the layer has another number.
std::vector<float> importance_of(const SafetensorsFile& file, std::size_t stage, int channels) {
  const std::string with = fmt::format("lin{}.model.1.weight", stage),
                    without = fmt::format("lin{}.model.0.weight", stage);
  return array_of(file, file.has(without) ? without : with, {1, channels, 1, 1}).values;
}

std::array<double, 3> colors_of(const SafetensorsFile& file, const std::string& name) {
  const FloatArray array = array_of(file, name, {1, 3, 1, 1});
  return {array.values[0], array.values[1], array.values[2]};
}

const NetworkPlan& plan_of(const SafetensorsFile& file) {
  for (const NetworkPlan& plan : kNetworks)
    if (file.has(std::string("net.") + plan.own_layer + ".weight")) return plan;
  file.refuse("it does not hold LPIPS with AlexNet or VGG-16");
}

int before(int size, int kernel, int stride, int padding) {
  return (size - 1) * stride + kernel - 2 * padding;
}

}  // namespace

LpipsWeights read_lpips_weights(const std::filesystem::path& path) {
  const SafetensorsFile file(path, kRemedy);
  const NetworkPlan& plan = plan_of(file);
  LpipsWeights weights{plan.name,
                       colors_of(file, "scaling_layer.shift"),
                       colors_of(file, "scaling_layer.scale"),
                       {},
                       {},
                       file.hash()};
  for (const double scale : weights.scale)
    if (scale == 0) file.refuse("scaling_layer.scale is 0");
  int channels = 3;
  for (const StagePlan& stage : plan.stages) {
    weights.stages.push_back(stage_of(file, stage, channels));
    channels = weights.stages.back().convolutions.back().outputs();
    weights.importance.push_back(importance_of(file, weights.importance.size(), channels));
  }
  return weights;
}

int smallest_picture(const std::vector<FeatureStage>& stages) {
  int size = 1;
  for (auto stage = stages.rbegin(); stage != stages.rend(); ++stage) {
    for (auto layer = stage->convolutions.rbegin(); layer != stage->convolutions.rend(); ++layer)
      size = std::max(1, before(size, layer->kernel(), layer->stride, layer->padding));
    if (stage->pool) size = before(size, stage->pool, 2, 0);
  }
  return size;
}

}  // namespace gs
