// SPDX-License-Identifier: Apache-2.0
// Training models for tests: made from Gaussians, filled with recognizable values, compared bit by
// bit.
#pragma once

#include "gs_train/decoded_moments.h"
#include "gs_train/training_model.h"
#include "tests/support/same_bits.h"
#include "tests/support/scenes.h"

namespace gs {

inline bool same_bits(const PhotometricState& a, const PhotometricState& b) {
  bool same = a.shape == b.shape && a.adam_steps == b.adam_steps && a.is_solved == b.is_solved;
  for_each_photometric_array(
      [&](const char*, const auto& x, const auto& y) { same &= same_bits(x, y); }, a, b);
  return same;
}
inline bool same_bits(const PoseState& a, const PoseState& b) {
  bool same = a.adam_steps == b.adam_steps;
  for_each_pose_array([&](const char*, const auto& x, const auto& y) { same &= x == y; }, a, b);
  return same;
}
inline bool same_bits(const MomentCodes& a, const MomentCodes& b) {
  bool same = true;
  for_each_array([&](const char*, const auto& x, const auto& y) { same &= same_bits(x, y); }, a, b);
  return same;
}
/// Compares parameters and moments, but not the statistics.
inline bool same_bits(const TrainingModel& a, const TrainingModel& b) {
  return same_bits(a.photometric, b.photometric) && same_bits(a.poses, b.poses) &&
         same_bits(a.gaussians, b.gaussians) && same_bits(a.first_moment, b.first_moment) &&
         same_bits(a.second_moment, b.second_moment) && a.moment_form == b.moment_form &&
         same_bits(a.codes, b.codes) && a.adam_steps == b.adam_steps;
}

/// The arrays of rows that differ, by name and with the first row that does; empty if there are
/// none. Both models have the same count.
inline std::string differing_arrays(const TrainingModel& a, const TrainingModel& b) {
  std::string names;
  if (a.count() != b.count()) return "their counts";
  for_each_row_array(
      [&](const RowArray& array, const auto& x, const auto& y) {
        for (std::size_t i = 0; i < x.size(); ++i)
          if (std::memcmp(x.data() + i, y.data() + i, sizeof x[0]) != 0) {
            names += std::string(array.group) + "." + array.name + " from row " +
                     std::to_string(i) + ", ";
            break;
          }
      },
      a, b);
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

inline constexpr MomentForm kMomentForms[] = {MomentForm::floats, MomentForm::tiny};

/// A model of these Gaussians with zero moments of this form, and zero statistics.
inline TrainingModel model_of(const Gaussians& gaussians, MomentForm form = MomentForm::floats) {
  TrainingModel model;
  model.gaussians = copy_of(gaussians);
  model.moment_form = form;
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

/// Fills codes with first, first + 1, ... over their rows, or what is left of these in their bits.
template <class T>
void number_codes(const Buffer<CodedRow<T>>& rows, std::uint32_t first) {
  const Span<TinyCode> codes = codes_of(rows);
  for (std::size_t i = 0; i < codes.size; ++i)
    codes[i].bits = std::uint16_t(first + i / (sizeof(T) / sizeof(float)));
}
/// The same for all codes of a model; the codes of each quantity begin `next` after those before.
inline void number_codes(TrainingModel& model, std::uint32_t first, std::uint32_t next = 0) {
  for_each_array(
      [&](const char*, const auto& array) {
        number_codes(array, first);
        first += next;
      },
      model.codes);
}

/// True where each number of row i is `value`.
template <class T>
bool row_is(const Buffer<T>& rows, std::size_t i, float value) {
  constexpr std::size_t width = sizeof(T) / sizeof(float);
  const Span<float> numbers = numbers_of(rows);
  return std::all_of(numbers.begin() + i * width, numbers.begin() + (i + 1) * width,
                     [&](float number) { return number == value; });
}
/// True where each code of row i is `value`.
template <class T>
bool codes_are(const Buffer<CodedRow<T>>& rows, std::size_t i, std::uint32_t value) {
  return std::all_of(std::begin(rows[i].number), std::end(rows[i].number),
                     [&](TinyCode code) { return code.bits == value; });
}
inline bool codes_are(const TrainingModel& model, std::size_t i, std::uint32_t value) {
  bool same = true;
  for_each_array([&](const char*, const auto& array) { same &= codes_are(array, i, value); },
                 model.codes);
  return same;
}

}  // namespace gs
