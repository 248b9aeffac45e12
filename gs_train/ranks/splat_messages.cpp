// SPDX-License-Identifier: Apache-2.0
#include "gs_train/ranks/splat_messages.h"

#include "gs_core/error.h"

namespace gs {
namespace {

template <class Row>
std::size_t total_of(const std::vector<std::vector<Row>>& sent) {
  std::size_t total = 0;
  for (const std::vector<Row>& rows : sent) total += rows.size();
  return total;
}

// Calls f(rank, sent) for each of the lists' members in the order of rows of the whole model. The
// lists are in that order, and chunks are dealt in turn: each chunk is one run of one list.
template <class Row, class F>
void for_each_in_order(const std::vector<std::vector<Row>>& sent, const Deal& deal, F&& f) {
  std::vector<std::size_t> next(sent.size(), 0);
  for (std::size_t chunk = 0; chunk < deal.chunk_count(); ++chunk) {
    const std::size_t rank = chunk % sent.size(), end = (chunk + 1) * deal.chunk_rows;
    const std::vector<Row>& rows = sent[rank];
    for (std::size_t& i = next[rank]; i < rows.size() && rows[i].row < end; ++i)
      f(int(rank), rows[i]);
  }
}

}  // namespace

std::vector<SentSplat> visible_splats(const RenderPass& pass, const Deal& deal, int rank,
                                      std::vector<std::uint32_t>& visible) {
  visible.clear();
  for (std::size_t i = 0; i < pass.tile_counts.size(); ++i)
    if (pass.tile_counts[i]) visible.push_back(std::uint32_t(i));
  std::vector<SentSplat> splats;
  splats.reserve(visible.size());
  for (const std::uint32_t i : visible)
    splats.push_back({std::uint32_t(deal.global_of(rank, i)), pass.tile_counts[i], pass.depths[i],
                      pass.pixel_rects[i], pass.splats[i]});
  return splats;
}

std::vector<int> merge_splats(const std::vector<std::vector<SentSplat>>& sent, const Deal& deal,
                              const Camera& camera, RenderPass& pass) {
  const std::size_t total = total_of(sent);
  pass.begin(camera, total);
  std::vector<int> ranks;
  ranks.reserve(total);
  for_each_in_order(sent, deal, [&](int rank, const SentSplat& sent_splat) {
    const std::size_t place = ranks.size();
    pass.splats[place] = sent_splat.splat;
    pass.depths[place] = sent_splat.depth;
    pass.pixel_rects[place] = sent_splat.pixels;
    pass.tile_counts[place] = sent_splat.tile_count;
    ranks.push_back(rank);
  });
  GS_CHECK(ranks.size() == total);
  return ranks;
}

std::vector<CameraGradientRow> merge_rows(const std::vector<Message>& sent, const Deal& deal) {
  std::vector<std::vector<CameraGradientRow>> rows;
  for (const Message& message : sent) rows.push_back(rows_in<CameraGradientRow>(message));
  std::vector<CameraGradientRow> merged;
  merged.reserve(total_of(rows));
  for_each_in_order(rows, deal,
                    [&](int, const CameraGradientRow& of_row) { merged.push_back(of_row); });
  GS_CHECK(merged.size() == total_of(rows));
  return merged;
}

SplatReply reply_of(const RenderPass& pass, const RenderSettings& settings, std::size_t i) {
  SplatReply reply{splat_gradient_of(pass, i), Vec2f(0.0f), {}};
  if (settings.absolute_gradient) reply.absolute_gradient = absolute_gradient_of(pass, i);
  if (settings.fragment_statistic != FragmentStatistic::none)
    reply.sums = fragment_sums_of(pass, i);
  return reply;
}

void take_replies(const std::vector<std::uint32_t>& visible, const std::vector<SplatReply>& replies,
                  const RenderSettings& settings, RenderPass& pass) {
  GS_CHECK(replies.size() == visible.size());
  const std::size_t count = replies.size();
  const bool has_sums = settings.fragment_statistic != FragmentStatistic::none;
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  scratch.first_instance.resize_discard(pass.tile_counts.size());
  scratch.instance_gradients.resize_discard(count);
  scratch.absolute_gradients.resize_discard(settings.absolute_gradient ? count : 0);
  scratch.fragment_sums.resize_discard(has_sums ? count : 0);
  pass.tile_counts.fill_zero();
  for (std::size_t k = 0; k < count; ++k) {
    pass.tile_counts[visible[k]] = 1;
    scratch.first_instance[visible[k]] = std::uint32_t(k);
    scratch.instance_gradients[k] = replies[k].gradient;
    if (settings.absolute_gradient) scratch.absolute_gradients[k] = replies[k].absolute_gradient;
    if (has_sums) scratch.fragment_sums[k] = replies[k].sums;
  }
}

}  // namespace gs
