// SPDX-License-Identifier: Apache-2.0
// Each stage is a chain of layers of its own, which OpenCV 4.6 computes to the last digits of float.
// The rest of LPIPS is not left to it: docs/method/equations.md says why.
#include <algorithm>
#include <opencv2/dnn.hpp>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/lpips/feature_network.h"

namespace gs {
namespace {

// OpenCV's threads for one call. The setting is the process's, and a program around gemsplat may
// have its own.
class ThreadsOfOpenCv {
 public:
  ThreadsOfOpenCv() : before_(cv::getNumThreads()) {
    cv::setNumThreads(std::min(thread_count(), cv::getNumberOfCPUs()));  // TBB warns of more
  }
  ~ThreadsOfOpenCv() { cv::setNumThreads(before_); }
  ThreadsOfOpenCv(const ThreadsOfOpenCv&) = delete;
  ThreadsOfOpenCv& operator=(const ThreadsOfOpenCv&) = delete;

 private:
  int before_;
};

cv::Mat copy_of(const FloatArray& array) {
  const std::vector<int> shape(array.shape.begin(), array.shape.end());
  return cv::Mat(shape, CV_32F, const_cast<float*>(array.values.data())).clone();
}

void add_pool(cv::dnn::Net& net, int kernel) {
  cv::dnn::LayerParams pool;
  pool.set("pool", "MAX");
  pool.set("kernel_size", kernel);
  pool.set("stride", 2);
  pool.set("ceil_mode", false);
  net.addLayerToPrev("pool", "Pooling", pool);
}

void add_convolution(cv::dnn::Net& net, const Convolution& layer, const std::string& name) {
  cv::dnn::LayerParams convolution, relu;
  convolution.set("kernel_size", layer.kernel());
  convolution.set("stride", layer.stride);
  convolution.set("pad", layer.padding);
  convolution.set("num_output", layer.outputs());
  convolution.set("bias_term", true);
  convolution.blobs = {copy_of(layer.weights), copy_of(layer.bias)};
  net.addLayerToPrev(name, "Convolution", convolution);
  net.addLayerToPrev(name + " relu", "ReLU", relu);
}

cv::dnn::Net net_of(const FeatureStage& stage) {
  cv::dnn::Net net;
  if (stage.pool) add_pool(net, stage.pool);
  for (std::size_t i = 0; i < stage.convolutions.size(); ++i)
    add_convolution(net, stage.convolutions[i], "convolution " + std::to_string(i));
  net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
  net.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
  return net;
}

FeatureMap copy_of(const cv::Mat& output) {
  GS_CHECK(output.dims == 4 && output.size[0] == 1 && output.isContinuous());
  const float* const values = output.ptr<float>();
  return {output.size[1], output.size[2], output.size[3], {values, values + output.total()}};
}

}  // namespace

bool can_measure_lpips() { return true; }

struct FeatureNetwork::Nets {
  std::vector<cv::dnn::Net> of_stages;
};

FeatureNetwork::FeatureNetwork(const std::vector<FeatureStage>& stages)
    : nets_(std::make_unique<Nets>()) {
  for (const FeatureStage& stage : stages) nets_->of_stages.push_back(net_of(stage));
}

FeatureNetwork::~FeatureNetwork() = default;

FeatureMap FeatureNetwork::features(std::size_t stage, const FeatureMap& before) {
  const ThreadsOfOpenCv threads;
  const int shape[] = {1, before.channels, before.height, before.width};
  cv::dnn::Net& net = nets_->of_stages.at(stage);
  try {
    net.setInput(cv::Mat(4, shape, CV_32F, const_cast<float*>(before.values.data())));
    return copy_of(net.forward());
  } catch (const cv::Exception& error) {
    if (error.code != cv::Error::StsNoMem) throw;
    throw Error(
        "the memory does not suffice for LPIPS; take AlexNet, or measure without it (--lpips none)",
        ExitCode::out_of_memory);
  }
}

}  // namespace gs
