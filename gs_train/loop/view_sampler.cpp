// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loop/view_sampler.h"

#include <numeric>
#include <utility>

#include "gs_core/error.h"

namespace gs {

ViewSampler::ViewSampler(std::size_t views, std::uint64_t seed)
    : random_{seed, RandomStream::view_order}, order_(views) {
  GS_CHECK(views > 0);
  shuffle(0);
}

std::size_t ViewSampler::view_of(int step) {
  const std::size_t position = std::size_t(step - 1);
  if (position / order_.size() != epoch_) shuffle(position / order_.size());
  return order_[position % order_.size()];
}

void ViewSampler::shuffle(std::uint64_t epoch) {
  epoch_ = epoch;
  std::iota(order_.begin(), order_.end(), std::size_t(0));
  for (std::size_t i = order_.size(); i > 1; --i)  // Fisher & Yates
    std::swap(order_[i - 1], order_[random_.below(std::uint32_t(i), epoch, std::uint32_t(i))]);
}

}  // namespace gs
