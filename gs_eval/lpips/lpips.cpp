// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/lpips/lpips.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr double kSmallestLength =
    1e-10;  // added to lengths of features, as in the package `lpips`
constexpr std::size_t kRowsPerThread = 4;

using Row = std::vector<double>;

/// The lengths of the features in one row, over all channels.
Row lengths_in(const FeatureMap& map, int y) {
  Row lengths(std::size_t(map.width));
  for (int c = 0; c < map.channels; ++c) {
    const float* const row = map.row(c, y);
    for (int x = 0; x < map.width; ++x) lengths[x] += double(row[x]) * row[x];
  }
  for (double& length : lengths) length = std::sqrt(length) + kSmallestLength;
  return lengths;
}

/// For each place of one row   sum_c w_c (a_c / |a| - b_c / |b|)^2          Zhang et al. 2018, Eq. 1
Row distances_in(const FeatureMap& a, const FeatureMap& b, const std::vector<float>& importance,
                 int y) {
  const Row a_lengths = lengths_in(a, y), b_lengths = lengths_in(b, y);
  Row distances(std::size_t(a.width));
  for (int c = 0; c < a.channels; ++c) {
    const float *const a_row = a.row(c, y), *const b_row = b.row(c, y);
    for (int x = 0; x < a.width; ++x) {
      const double difference = a_row[x] / a_lengths[x] - b_row[x] / b_lengths[x];
      distances[x] += double(importance[c]) * difference * difference;
    }
  }
  return distances;
}

/// The pixels [begin, end) of a side that belong to one place of a map; together they cover it.
struct Pixels {
  int begin, end;
};
Pixels pixels_at(int place, int places, int pixels) {
  const auto border = [&](int i) { return int(std::int64_t(i) * pixels / places); };
  return {border(place), border(place + 1)};
}

/// The mean weight of the pixels that belong to each place of one row of the map.
Row weights_in(const ComparedPictures& pictures, const FeatureMap& map, int y) {
  Row weights(std::size_t(map.width), 1.0);
  if (pictures.weight.empty()) return weights;
  const Pixels rows = pixels_at(y, map.height, pictures.weight.height);
  for (int x = 0; x < map.width; ++x) {
    const Pixels columns = pixels_at(x, map.width, pictures.weight.width);
    double sum = 0;
    for (int v = rows.begin; v < rows.end; ++v)
      for (int u = columns.begin; u < columns.end; ++u) sum += pictures.weight_at(u, v);
    weights[x] = sum / (double(rows.end - rows.begin) * (columns.end - columns.begin));
  }
  return weights;
}

/// The mean over the places of a map, each as much as its pixels count.
double mean_distance(const FeatureMap& a, const FeatureMap& b, const std::vector<float>& importance,
                     const ComparedPictures& pictures) {
  Row sums(std::size_t(a.height)), shares(std::size_t(a.height));
  parallel_for(sums.size(), kRowsPerThread, [&](std::size_t y) {
    const Row distances = distances_in(a, b, importance, int(y));
    const Row weights = weights_in(pictures, a, int(y));
    sums[y] = std::inner_product(weights.begin(), weights.end(), distances.begin(), 0.0);
    shares[y] = std::accumulate(weights.begin(), weights.end(), 0.0);
  });
  const double share = std::accumulate(shares.begin(), shares.end(), 0.0);
  GS_CHECK(share > 0);
  return std::accumulate(sums.begin(), sums.end(), 0.0) / share;
}

}  // namespace

Lpips::Lpips(const std::string& file)
    : file_(file), weights_(read_lpips_weights(file)), nets_(weights_.stages) {}

void Lpips::check_size(int width, int height) const {
  const int smallest = smallest_picture(weights_.stages);
  if (std::min(width, height) < smallest)
    throw UsageError(
        fmt::format("pictures of {}x{} pixels are too small for LPIPS, which needs {}x{}; "
                    "take larger ones (-r 1), or measure without it (--lpips none)",
                    width, height, smallest, smallest));
}

void Lpips::check_sizes(const std::vector<View>& views) const {
  for (const View& view : views) check_size(view.camera.width, view.camera.height);
}

double Lpips::distance(const ComparedPictures& pictures) {
  const ImageF &render = pictures.render, &photo = pictures.photo;
  GS_CHECK(render.width == photo.width && render.height == photo.height && render.channels == 3 &&
           photo.channels == 3);
  check_size(render.width, render.height);
  FeatureMap a = input_of(render), b = input_of(photo);
  double sum = 0;
  for (std::size_t stage = 0; stage < weights_.stages.size(); ++stage) {
    a = nets_.features(stage, a);
    b = nets_.features(stage, b);
    sum += mean_distance(a, b, weights_.importance[stage], pictures);
  }
  return sum;
}

// Red, green, blue as planes, from [0, 1] to [-1, 1] and to what the network was trained with.
FeatureMap Lpips::input_of(const ImageF& picture) const {
  const std::size_t plane = std::size_t(picture.width) * picture.height;
  FeatureMap input{3, picture.height, picture.width, std::vector<float>(3 * plane)};
  for (std::size_t i = 0; i < picture.pixels.size(); ++i) {
    const std::size_t c = i % 3;
    input.values[c * plane + i / 3] =
        float((2 * double(picture.pixels[i]) - 1 - weights_.shift[c]) / weights_.scale[c]);
  }
  return input;
}

std::unique_ptr<Lpips> make_lpips(const EvalConfig& settings) {
  if (settings.lpips.empty() || settings.lpips == "none") return nullptr;
  if (!std::filesystem::exists(settings.lpips))
    throw UsageError(
        "there is no file " + settings.lpips +
        ", which has the network for LPIPS (eval.lpips); name it with --lpips FILE, or "
        "measure without it (--lpips none)");
  return std::make_unique<Lpips>(settings.lpips);
}

}  // namespace gs
