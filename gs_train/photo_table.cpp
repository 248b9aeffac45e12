// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photo_table.h"

#include <initializer_list>

#include "gs_core/error.h"
#include "gs_core/math/loss/pull.h"

namespace gs {

void PhotoTable::begin(std::size_t row_count, std::size_t number_count) {
  GS_CHECK(number_count <= kMostPhotoNumbers);
  rows = std::uint32_t(row_count);
  numbers = std::uint32_t(number_count);
  for (ByteBuffer* const array : std::initializer_list<ByteBuffer*>{&values, &moments, &start}) {
    array->resize_discard(size());
    array->fill_zero();
  }
}

void copy_table(const PhotoTable& from, PhotoTable& to) {
  to.rows = from.rows;
  to.numbers = from.numbers;
  to.values.upload(from.values.download());
  to.moments.upload(from.moments.download());
  to.start.upload(from.start.download());
  to.modes.upload(from.modes.download());
  to.mode_length2 = from.mode_length2;
  to.adam_steps = from.adam_steps;
}

void update_table(PhotoTable& table, const PhotoPulls& pulls, float rate, const AdamRule& rule,
                  std::vector<double>& gradient) {
  GS_CHECK(gradient.size() == table.size());
  const AdamStep step = adam_step(table.adam_steps += rule.steps, rate);
  for (std::size_t i = 0; i < gradient.size(); ++i) {
    const PhotoPull& pull = pulls[i % table.numbers];
    gradient[i] +=
        pull_vjp(double(table.values[i]), double(table.start[i]), pull.weight, pull.spread);
    adam_update(table.values[i], table.moments[i], float(gradient[i]), step, rule);
  }
  take_out_modes(table);
}

void take_out_modes(PhotoTable& table) {
  for (std::size_t k = 0; k < table.mode_count(); ++k) {
    const double* const mode = table.modes.data() + k * table.size();
    double sum = 0;
    for (std::size_t i = 0; i < table.size(); ++i) sum += mode[i] * double(table.values[i]);
    const double share = sum / table.mode_length2;
    for (std::size_t i = 0; i < table.size(); ++i)
      table.values[i] = float(double(table.values[i]) - share * mode[i]);
  }
}

}  // namespace gs
