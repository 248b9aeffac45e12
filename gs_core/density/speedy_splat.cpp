// SPDX-License-Identifier: Apache-2.0
// The method "speedy_splat": most of the Gaussians to which the loss is least sensitive go at times
// while there are refinements, and a third afterwards.       Hanson et al. 2025, Speedy-Splat
//
// Source: the paper, arXiv 2412.00578; its code was not read. What differs: the sensitivity is that of
// the loss, not of the picture, to f = alpha dE/dalpha, and is measured in the steps of the epoch
// before, in which nothing grows.
#include "gs_core/density/growth_method.h"

namespace gs {
namespace {

constexpr float kSoftPrune = 0.8f, kHardPrune = 0.3f;  // shares of the Gaussians
constexpr int kFrom = 6000, kEvery = 3000, kUntil = 27000;

}  // namespace

GrowthMethod speedy_splat_method() {
  GrowthMethod method;
  method.soft_prune = kSoftPrune;
  method.hard_prune = kHardPrune;
  method.share_prune_from = kFrom;
  method.share_prune_every = kEvery;
  method.share_prune_until = kUntil;
  return method;
}

}  // namespace gs
