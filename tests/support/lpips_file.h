// SPDX-License-Identifier: Apache-2.0
// Files with small networks of LPIPS: the layers of AlexNet or VGG-16 with a few channels.
#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "gs_core/system/safetensors.h"
#include "gs_core/system/text/json.h"
#include "tests/support/temp_folder.h"

namespace gs {

using Arrays = std::map<std::string, FloatArray>;

/// The bytes of a safetensors file.
inline std::string safetensors_bytes(const Arrays& arrays, const std::string& kind = "F32") {
  SortedJson header = {{"__metadata__", {{"format", "pt"}}}};
  std::string data;
  for (const auto& [name, array] : arrays) {
    const std::size_t begin = data.size();
    data.append(reinterpret_cast<const char*>(array.values.data()),
                array.values.size() * sizeof(float));
    header[name] = {
        {"dtype", kind}, {"shape", array.shape}, {"data_offsets", {begin, data.size()}}};
  }
  const std::string text = header.dump();
  const std::uint64_t length = text.size();
  return std::string(reinterpret_cast<const char*>(&length), sizeof length) + text + data;
}

/// The convolutions of both networks: name, kernel, and the stage whose number of channels they give.
struct NamedConvolution {
  std::string name;
  int kernel, stage;
};
inline std::vector<NamedConvolution> convolutions_of(const std::string& network) {
  if (network == "alex")
    return {{"slice1.0", 11, 0},
            {"slice2.3", 5, 1},
            {"slice3.6", 3, 2},
            {"slice4.8", 3, 3},
            {"slice5.10", 3, 4}};
  std::vector<NamedConvolution> all;
  const std::vector<std::vector<int>> layers = {
      {0, 2}, {5, 7}, {10, 12, 14}, {17, 19, 21}, {24, 26, 28}};
  for (int stage = 0; stage < 5; ++stage)
    for (const int layer : layers[std::size_t(stage)])
      all.push_back({"slice" + std::to_string(stage + 1) + "." + std::to_string(layer), 3, stage});
  return all;
}

inline FloatArray zeros(std::vector<std::int64_t> shape) {
  std::size_t count = 1;
  for (const std::int64_t size : shape) count *= std::size_t(size);
  return {std::move(shape), std::vector<float>(count)};
}

/// A network whose weights are 0, and that takes colors in [-1, 1] as they are.
inline Arrays empty_network(const std::string& network, const std::vector<int>& channels) {
  Arrays arrays = {{"scaling_layer.shift", zeros({1, 3, 1, 1})},
                   {"scaling_layer.scale", {{1, 3, 1, 1}, {1, 1, 1}}}};
  int inputs = 3;
  for (const auto& [name, kernel, stage] : convolutions_of(network)) {
    const int outputs = channels[std::size_t(stage)];
    arrays["net." + name + ".weight"] = zeros({outputs, inputs, kernel, kernel});
    arrays["net." + name + ".bias"] = zeros({outputs});
    inputs = outputs;
  }
  for (std::size_t stage = 0; stage < 5; ++stage)
    arrays["lin" + std::to_string(stage) + ".model.1.weight"] = zeros({1, channels[stage], 1, 1});
  return arrays;
}

/// A network whose weights look random. tests/train/metrics/lpips_reference.py makes the same one.
inline Arrays patterned_network(const std::string& network, const std::vector<int>& channels) {
  Arrays arrays = empty_network(network, channels);
  std::uint64_t number = 0;
  for (auto& [name, array] : arrays) {
    const std::size_t taps = array.values.size() / std::size_t(array.shape[0]);
    for (std::uint64_t i = 0; i < array.values.size(); ++i) {
      const double u = double((7919 * i + 104729 * number + 13) % 1009) / 1009;
      const double value = name.ends_with("shift")   ? 0.3 * (u - 0.5)
                           : name.ends_with("scale") ? 0.5 + 0.2 * u
                           : name.starts_with("lin") ? u
                           : name.ends_with("bias")  ? 0.2 * (u - 0.5)
                                                     : 4 * (u - 0.5) / std::sqrt(double(taps));
      array.values[i] = float(value);
    }
    ++number;
  }
  return arrays;
}

/// The first convolution's first channel is the value of one color, and its second one is 1. Of
/// AlexNet with two channels in each stage; all later stages pass both on.
inline Arrays color_network(int color, const std::vector<float>& importance) {
  Arrays arrays = empty_network("alex", {2, 2, 2, 2, 2});
  const auto set = [&](const std::string& name, std::initializer_list<int> at, float value) {
    FloatArray& array = arrays.at(name);
    std::size_t index = 0, k = 0;
    for (const int i : at) index = index * std::size_t(array.shape[k++]) + std::size_t(i);
    array.values[index] = value;
  };
  set("net.slice1.0.weight", {0, color, 5, 5}, 1);
  set("net.slice1.0.bias", {1}, 1);
  for (const auto& [name, kernel, stage] : convolutions_of("alex"))
    for (int c = 0; stage > 0 && c < 2; ++c)
      set("net." + name + ".weight", {c, c, kernel / 2, kernel / 2}, 1);
  for (std::size_t stage = 0; stage < 5; ++stage)
    arrays.at("lin" + std::to_string(stage) + ".model.1.weight").values = importance;
  return arrays;
}

inline std::string write_network(const std::filesystem::path& file, const Arrays& arrays) {
  write_bytes(file, safetensors_bytes(arrays));
  return file.string();
}

}  // namespace gs
