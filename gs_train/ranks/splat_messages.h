// SPDX-License-Identifier: Apache-2.0
// What ranks send to each other in a step: projected Gaussians to the rank that draws the view,
// gradients back, and to all ranks what they add to the gradient of a camera.
#pragma once

#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

#include "gs_render/stages.h"
#include "gs_train/ranks/communicator.h"
#include "gs_train/ranks/deal.h"

namespace gs {

/// A visible Gaussian of a rank in one view, as stage 1 leaves it.
struct SentSplat {
  std::uint32_t row;  // of the whole model
  std::uint32_t tile_count;
  float depth;
  Rect pixels;
  Splat splat;
};

/// What its rank needs to know of the backward pass.
struct SplatReply {
  SplatGradient gradient;
  Vec2f absolute_gradient;  // by the mean; 0 without RenderSettings::absolute_gradient
  FragmentSums sums;        // 0 without a fragment_statistic
};

template <class T>
Message message_of(const std::vector<T>& rows) {
  static_assert(std::is_trivially_copyable_v<T>);
  Message message(rows.size() * sizeof(T));
  if (!rows.empty()) std::memcpy(message.data(), rows.data(), message.size());
  return message;
}

template <class T>
std::vector<T> rows_in(const Message& message) {
  static_assert(std::is_trivially_copyable_v<T>);
  std::vector<T> rows(message.size() / sizeof(T));
  if (!rows.empty()) std::memcpy(rows.data(), message.data(), rows.size() * sizeof(T));
  return rows;
}

/// The visible Gaussians that stage 1 has left in `pass`, in the order of rows. `visible` becomes
/// their local rows.
std::vector<SentSplat> visible_splats(const RenderPass& pass, const Deal& deal, int rank,
                                      std::vector<std::uint32_t>& visible);

/// Fills a pass as stage 1 would for the whole model without its culled rows: the splats of all
/// ranks in the order of rows. pass.begin() sets its size. Returns the rank of each.
///
/// sent   (ranks) as visible_splats() returns them
std::vector<int> merge_splats(const std::vector<std::vector<SentSplat>>& sent, const Deal& deal,
                              const Camera& camera, RenderPass& pass);

/// What the visible Gaussians of all ranks add to the gradient of a camera, in the order of rows.
///
/// sent   (ranks) of CameraGradientRow, with rows of the whole model
std::vector<CameraGradientRow> merge_rows(const std::vector<Message>& sent, const Deal& deal);

/// What the backward pass has left for a splat.
SplatReply reply_of(const RenderPass& pass, const RenderSettings& settings, std::size_t i);

/// Fills a pass of a rank's rows so that the stages after the backward pass find the replies in it:
/// each visible Gaussian has one instance, with the sums of all its instances.
void take_replies(const std::vector<std::uint32_t>& visible, const std::vector<SplatReply>& replies,
                  const RenderSettings& settings, RenderPass& pass);

}  // namespace gs
