// SPDX-License-Identifier: Apache-2.0
// Training models for tests: made from Gaussians, filled with recognizable values, compared bit by
// bit.
#pragma once

#include "gs_train/opened_moments.h"
#include "gs_train/training_model.h"
#include "gs_train/update.h"
#include "tests/support/same_bits.h"
#include "tests/support/scenes.h"

namespace gs {

inline bool same_bits(const PhotometricState& a, const PhotometricState& b) {
  bool same = a.rows == b.rows && a.numbers == b.numbers && a.adam_steps == b.adam_steps &&
              a.is_solved == b.is_solved;
  for_each_photometric_array(
      [&](const char*, const auto& x, const auto& y) { same &= same_bits(x, y); }, a, b);
  return same;
}
inline bool same_bits(const PoseState& a, const PoseState& b) {
  bool same = a.adam_steps == b.adam_steps;
  for_each_pose_array([&](const char*, const auto& x, const auto& y) { same &= same_bits(x, y); },
                      a, b);
  return same;
}
inline bool same_bits(const StoredMoments& a, const StoredMoments& b) {
  const auto columns = [](const StoredMoments& moments) {
    return std::visit([](auto& of) { return columns_in(of, RowRole::moment, "moments"); }, moments);
  };
  return a.index() == b.index() && same_bits(columns(a), columns(b));
}
/// Compares parameters and moments, but not the statistics.
inline bool same_bits(const TrainingModel& a, const TrainingModel& b) {
  return same_bits(a.photometric, b.photometric) && same_bits(a.poses, b.poses) &&
         same_bits(a.gaussians, b.gaussians) && same_bits(a.moments, b.moments) &&
         a.adam_steps == b.adam_steps;
}

/// The arrays of rows that differ, by name and with the first row that does; empty if there are
/// none. Both models have the same count.
inline std::string differing_arrays(const TrainingModel& a, const TrainingModel& b) {
  std::string names;
  if (a.count() != b.count()) return "their counts";
  const ConstColumns of_a = a.columns(), of_b = b.columns();
  for (std::size_t k = 0; k < of_a.size(); ++k) {
    const ByteBuffer &x = *of_a[k].rows, &y = *of_b[k].rows;
    for (std::size_t i = 0; i < x.size(); ++i)
      if (std::memcmp(x.row(i), y.row(i), x.row_bytes()) != 0) {
        names += of_a[k].key() + " from row " + std::to_string(i) + ", ";
        break;
      }
  }
  return names;
}

/// Gradients of very different sizes, of which a share is zero.
inline Gaussians random_gradients(std::size_t count, std::uint64_t seed, float zeros = 0) {
  Gaussians gradients(count, host_memory());
  Draws draws(seed);
  for_each_array(
      [&](const char*, const auto& array) {
        for (float& number : numbers_of(array)) {
          const bool is_zero = zeros > 0 && draws.chance(zeros);
          number = is_zero ? 0 : draws.normal() * draws.log_uniform(1e-8f, 1);
        }
      },
      gradients);
  return gradients;
}

/// The rates of the schedule in its middle.
inline constexpr LearningRates kRates{1e-4f, 5e-3f, 1e-3f, 2.5e-2f, 2.5e-3f, 1.25e-4f};

inline constexpr MomentStorage kMomentStorages[] = {MomentStorage::floats, MomentStorage::halves};

/// A model of these Gaussians with moments and statistics of zero.
inline TrainingModel model_of(const Gaussians& gaussians,
                              MomentStorage storage = MomentStorage::floats) {
  TrainingModel model;
  model.gaussians = copy_of(gaussians);
  model.store_moments_as(storage);
  clear_history(model);
  return model;
}

/// Fills an array with first, first + 1, ... over its rows, each number of a row the same.
template <class T>
void number_rows(const Buffer<T>& rows, float first) {
  const Span<float> numbers = numbers_of(rows);
  for (std::size_t i = 0; i < numbers.size; ++i)
    numbers[i] = first + float(i / (sizeof(T) / sizeof(float)));
}

/// Moments that tell a number: zero for 0.
template <class Stored>
Stored numbered(std::uint32_t number) {
  if constexpr (std::is_same_v<Stored, FloatMoments>)
    return {float(number), 2 * float(number)};
  else
    return {std::uint16_t(number)};
}
/// Fills moments with those of first, first + 1, ... over their rows, each number of a row the same.
template <class Stored, class T>
void number_moments(const Buffer<MomentRow<Stored, T>>& rows, std::uint32_t first) {
  for (MomentRow<Stored, T>& row : rows)
    std::fill(std::begin(row.number), std::end(row.number), numbered<Stored>(first++));
}
/// The same for all moments of a model; those of each quantity begin `next` after those before.
inline void number_moments(TrainingModel& model, std::uint32_t first, std::uint32_t next = 0) {
  std::visit(
      [&](const auto& moments) {
        for_each_array(
            [&](const char*, const auto& rows) {
              number_moments(rows, first);
              first += next;
            },
            moments);
      },
      model.moments);
}

/// True where each number of row i is `value`.
template <class T>
bool row_is(const Buffer<T>& rows, std::size_t i, float value) {
  constexpr std::size_t width = sizeof(T) / sizeof(float);
  const Span<float> numbers = numbers_of(rows);
  return std::all_of(numbers.begin() + i * width, numbers.begin() + (i + 1) * width,
                     [&](float number) { return number == value; });
}
/// True where all moments of row i are numbered(value).
template <class Stored, class T>
bool moments_are(const Buffer<MomentRow<Stored, T>>& rows, std::size_t i, std::uint32_t value) {
  const Stored expected = numbered<Stored>(value);
  return std::all_of(
      std::begin(rows[i].number), std::end(rows[i].number),
      [&](const Stored& moments) { return std::memcmp(&moments, &expected, sizeof moments) == 0; });
}
inline bool moments_are(const TrainingModel& model, std::size_t i, std::uint32_t value) {
  bool same = true;
  std::visit(
      [&](const auto& moments) {
        for_each_array([&](const char*, const auto& rows) { same &= moments_are(rows, i, value); },
                       moments);
      },
      model.moments);
  return same;
}
/// One of the moments of the numbers of photos, downloaded.
inline std::vector<float> each_of(const std::vector<FloatMoments>& pairs,
                                  float FloatMoments::*moment) {
  std::vector<float> values;
  for (const FloatMoments& pair : pairs) values.push_back(pair.*moment);
  return values;
}
inline std::vector<float> first_moments(const PhotoTable& table) {
  return each_of(table.moments.download(), &FloatMoments::first);
}
inline std::vector<float> second_moments(const PhotoTable& table) {
  return each_of(table.moments.download(), &FloatMoments::second);
}
/// The moments of a model that has FloatMoments.
inline AdamMoments<FloatMoments>& float_moments(TrainingModel& model) {
  return std::get<AdamMoments<FloatMoments>>(model.moments);
}
inline const AdamMoments<FloatMoments>& float_moments(const TrainingModel& model) {
  return std::get<AdamMoments<FloatMoments>>(model.moments);
}

}  // namespace gs
