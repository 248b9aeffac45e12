// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/looks/held_out.h"

#include <algorithm>
#include <cmath>

#include "gs_core/geometry/vectors.h"
#include "gs_train/named_row.h"

namespace gs {
namespace {

constexpr std::size_t kNearest = 4;

/// A photo of the scene. Those of test views have no numbers.
struct Shot {
  const View* view;
  const float* numbers;
};

/// All photos by name, with the one that is to be predicted.
struct Question {
  const std::vector<Shot>& shots;
  std::size_t asked;
  std::vector<std::size_t> known;  // of its camera, or of all; ascending
};

using Weights = std::vector<std::pair<std::size_t, double>>;  // photos, with a sum of 1

Weights even(const std::vector<std::size_t>& photos, std::size_t count) {
  Weights weights;
  for (std::size_t i = 0; i < count; ++i) weights.push_back({photos[i], 1 / double(count)});
  return weights;
}

Weights by_mean(const Question& question) { return even(question.known, question.known.size()); }

Weights by_neighbors(const Question& question) {
  const auto next = std::lower_bound(question.known.begin(), question.known.end(), question.asked);
  if (next == question.known.begin()) return {{*next, 1}};
  const std::size_t before = *(next - 1);
  if (next == question.known.end()) return {{before, 1}};
  const double t = double(question.asked - before) / double(*next - before);
  return {{before, 1 - t}, {*next, t}};
}

Weights by_nearest(const Question& question) {
  const Vec3f place = question.shots[question.asked].view->camera.position();
  const auto distance2 = [&](std::size_t i) {
    const Vec3f d = question.shots[i].view->camera.position() - place;
    return inner(d, d);
  };
  std::vector<std::size_t> photos = question.known;
  const std::size_t count = std::min(kNearest, photos.size());
  std::partial_sort(photos.begin(), photos.begin() + std::ptrdiff_t(count), photos.end(),
                    [&](std::size_t a, std::size_t b) {
                      const float x = distance2(a), y = distance2(b);
                      return x != y ? x < y : a < b;
                    });
  return even(photos, count);
}

// The line through known photos at x_i gives sum_i w_i y_i at x, with
//
//   w_i = 1/n + (x - mean) (x_i - mean) / sum_k (x_k - mean)^2
Weights by_exif(const Question& question) {
  const auto stops = [&](std::size_t i) { return question.shots[i].view->exposure_stops; };
  Weights weights;
  for (const std::size_t i : question.known)
    if (stops(i)) weights.push_back({i, 0});
  if (weights.empty() || !stops(question.asked)) return by_mean(question);
  double mean = 0, squares = 0;
  for (const auto& [i, weight] : weights) mean += double(*stops(i)) / double(weights.size());
  for (const auto& [i, weight] : weights) squares += (*stops(i) - mean) * (*stops(i) - mean);
  const double slope = squares > 0 ? (double(*stops(question.asked)) - mean) / squares : 0;
  for (auto& [i, weight] : weights)
    weight = 1 / double(weights.size()) + slope * (double(*stops(i)) - mean);
  return weights;
}

struct RuleRow {
  const char* name;
  Weights (*weights)(const Question&);
  bool needs_exif = false;
};
constexpr RuleRow kRules[] = {{"mean", by_mean},
                              {"neighbors", by_neighbors},
                              {"nearest", by_nearest},
                              {"exif", by_exif, true}};

bool has_exif(const std::vector<Shot>& shots) {
  return std::any_of(shots.begin(), shots.end(), [](const Shot& shot) {
    return shot.numbers && shot.view->exposure_stops.has_value();
  });
}

std::vector<Shot> shots_of(const PhotometricState& state, const Scene& scene) {
  std::vector<Shot> shots;
  for (std::size_t i = 0; i < scene.train_views.size(); ++i)
    shots.push_back({&scene.train_views[i], state.row(i).data});
  for (const View& view : scene.test_views) shots.push_back({&view, nullptr});
  std::sort(shots.begin(), shots.end(),
            [](const Shot& a, const Shot& b) { return a.view->name < b.view->name; });
  return shots;
}

Question question_of(const std::vector<Shot>& shots, std::size_t asked) {
  Question question{shots, asked, {}};
  const auto gather = [&](bool same_camera) {
    for (std::size_t i = 0; i < shots.size(); ++i)
      if (i != asked && shots[i].numbers &&
          (!same_camera || shots[i].view->camera_id == shots[asked].view->camera_id))
        question.known.push_back(i);
  };
  gather(true);
  if (question.known.empty()) gather(false);
  return question;
}

std::vector<float> predicted(const RuleRow& rule, const Question& question, std::size_t size) {
  std::vector<float> numbers(size, 0.0f);
  if (question.known.empty()) return numbers;
  for (const auto& [photo, weight] : rule.weights(question))
    for (std::size_t k = 0; k < size; ++k)
      numbers[k] += float(weight) * question.shots[photo].numbers[k];
  return numbers;
}

double spread_of(const RuleRow& rule, const std::vector<Question>& questions, std::size_t size) {
  double sum = 0;
  for (const Question& question : questions) {
    const std::vector<float> numbers = predicted(rule, question, size);
    for (std::size_t k = 0; k < size; ++k) {
      const double error = double(numbers[k]) - double(question.shots[question.asked].numbers[k]);
      sum += error * error;
    }
  }
  return std::sqrt(sum / double(std::max<std::size_t>(questions.size() * size, 1)));
}

}  // namespace

HeldOutPhotos predict_held_out(const PhotometricState& state, const Scene& scene) {
  const std::vector<Shot> shots = shots_of(state, scene);
  const std::size_t size = state.numbers;
  std::vector<Question> left_out;
  for (std::size_t i = 0; i < shots.size(); ++i)
    if (shots[i].numbers) left_out.push_back(question_of(shots, i));
  HeldOutPhotos photos;
  const RuleRow* best = nullptr;
  double least = 0;
  for (const RuleRow& rule : kRules) {
    if (rule.needs_exif && !has_exif(shots)) continue;
    const double spread = spread_of(rule, left_out, size);
    photos.rules.push_back({rule.name, spread});
    if (!best || spread < least) best = &rule, least = spread;
  }
  photos.rule = best->name;
  for (const View& view : scene.test_views) {
    const auto shot = std::find_if(shots.begin(), shots.end(),
                                   [&](const Shot& other) { return other.view == &view; });
    photos.numbers.push_back(
        predicted(*best, question_of(shots, std::size_t(shot - shots.begin())), size));
  }
  return photos;
}

}  // namespace gs
