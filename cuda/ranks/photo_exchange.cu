// SPDX-License-Identifier: Apache-2.0
#include "cuda/ranks/photo_exchange.cuh"

#include "cuda/ranks/chunk_copies.cuh"
#include "cuda/render/reports.cuh"

namespace gs::cuda {
namespace {

constexpr std::size_t kAlignment = 16;  // of the parts of a message

constexpr std::size_t aligned(std::size_t bytes) {
  return (bytes + kAlignment - 1) / kAlignment * kAlignment;
}

// The reports of the photos that one rank has drawn.
struct OwnReports {
  int photos;
  const StepReport* of[DrawerStatus::kMostPhotos];
};

__global__ void write_status_kernel(DrawerStatus* to, const std::uint32_t* halted,
                                    const __grid_constant__ OwnReports reports) {
  to->halted = *halted;
  for (int i = 0; i < reports.photos; ++i)
    to->instances[i] = static_cast<const volatile StepReport*>(reports.of[i])->instances;
}

// The photos that other ranks have drawn.
struct OtherReports {
  int photos;
  struct {
    StepReport* report;
    std::uint32_t number;
    int drawer, among_its_own;
  } of[kMostBatch];
};

__global__ void take_status_kernel(const DrawerStatus* statuses, std::uint32_t* halted,
                                   const __grid_constant__ OtherReports reports) {
  std::uint32_t any = *halted;
  for (int i = 0; i < reports.photos; ++i) any |= statuses[reports.of[i].drawer].halted;
  *halted = any;
  for (int i = 0; i < reports.photos; ++i) {
    const auto& of = reports.of[i];
    write_report(of.report, statuses[of.drawer].instances[of.among_its_own], any, of.number);
  }
}

}  // namespace

std::vector<PhotoExchange::Rows> PhotoExchange::rows_of(const PhotoUnderWay& photo, Way way) {
  std::vector<Rows> all;
  const auto add = [&](auto* rows) {
    if (rows) all.push_back({reinterpret_cast<std::byte*>(rows), sizeof *rows});
  };
  if (way == Way::to_drawer) {
    add(photo.rows.splats);
    add(photo.rows.pixel_rects);
    add(photo.rows.tile_counts);
    add(photo.rows.depth_keys);
  } else {
    add(photo.rows.gradients);
    add(photo.sums);
    add(photo.fixed_sums);
  }
  return all;
}

bool PhotoExchange::draws(const std::vector<PhotoUnderWay>& photos, int rank) const {
  for (const PhotoUnderWay& photo : photos)
    if (photo.drawer == rank) return true;
  return false;
}

PhotoExchange::Messages PhotoExchange::messages(const Deal& deal,
                                                const std::vector<PhotoUnderWay>& photos, Way way,
                                                bool are_drawn_here,
                                                Buffer<std::byte>& room) const {
  // Places come first as numbers of bytes, since the room may have to grow for them.
  struct Place {
    Rows rows;
    int rank;
    std::size_t at;
  };
  struct Range {
    int rank;
    std::size_t begin, end;
  };
  std::vector<Place> places;
  std::vector<Range> ranges;
  std::size_t end = 0;
  for (int other = 0; other < count_; ++other) {
    if (other == rank_) continue;
    const int drawer = are_drawn_here ? rank_ : other, owner = are_drawn_here ? other : rank_;
    const std::size_t begin = end;
    for (const PhotoUnderWay& photo : photos) {
      if (photo.drawer != drawer) continue;
      for (const Rows& rows : rows_of(photo, way)) {
        places.push_back({rows, owner, end});
        end += aligned(deal.count_of(owner) * rows.row_bytes);
      }
    }
    if (end > begin) ranges.push_back({other, begin, end});
  }
  if (room.size() < end) room.resize_discard(end);
  Messages all;
  for (const Place& place : places)
    all.parts.push_back({place.rows, place.rank, room.data() + place.at});
  for (const Range& range : ranges)
    all.pieces.push_back({range.rank, room.data() + range.begin, range.end - range.begin});
  return all;
}

void PhotoExchange::pack(const Deal& deal, const Messages& messages) const {
  for (const Part& part : messages.parts)
    copy_chunks_out(context_, deal, part.rank, part.rows.row_bytes, 0, deal.count_of(part.rank),
                    part.rows.data, part.at);
}

void PhotoExchange::unpack(const Deal& deal, const Messages& messages) const {
  for (const Part& part : messages.parts)
    copy_chunks_back(context_, deal, part.rank, part.rows.row_bytes, 0, deal.count_of(part.rank),
                     part.at, part.rows.data);
}

void PhotoExchange::send_splats(const Deal& deal, const std::vector<PhotoUnderWay>& photos,
                                DeviceLink& link) {
  const StageScope scope(context_, "send splats");
  const Messages sent = messages(deal, photos, Way::to_drawer, false, outgoing_);
  const Messages received = messages(deal, photos, Way::to_drawer, true, incoming_);
  pack(deal, sent);
  link.exchange(sent.pieces, received.pieces, context_.stream());
  unpack(deal, received);
}

void PhotoExchange::send_gradients(const Deal& deal, const std::vector<PhotoUnderWay>& photos,
                                   std::uint32_t* halted, DeviceLink& link) {
  const StageScope scope(context_, "send gradients");
  Messages sent = messages(deal, photos, Way::from_drawer, true, outgoing_);
  Messages received = messages(deal, photos, Way::from_drawer, false, incoming_);
  pack(deal, sent);
  for (const Part& part : sent.parts)
    clear_chunks(context_, deal, part.rank, part.rows.row_bytes, part.rows.data);
  for (const PhotoUnderWay& photo : photos) {
    if (photo.look.empty()) continue;
    const std::size_t bytes = photo.look.size * sizeof(double);
    if (photo.drawer != rank_) {
      received.pieces.push_back({photo.drawer, photo.look.data, bytes});
      continue;
    }
    for (int other = 0; other < count_; ++other)
      if (other != rank_) sent.pieces.push_back({other, photo.look.data, bytes});
  }
  exchange_status(photos, halted, sent.pieces, received.pieces);
  link.exchange(sent.pieces, received.pieces, context_.stream());
  unpack(deal, received);
  take_status(photos, halted);
}

void PhotoExchange::exchange_status(const std::vector<PhotoUnderWay>& photos, std::uint32_t* halted,
                                    std::vector<DevicePiece>& sent,
                                    std::vector<DevicePiece>& received) {
  if (statuses_.empty()) statuses_.resize_discard(std::size_t(count_));
  OwnReports own{};
  for (const PhotoUnderWay& photo : photos) {
    if (photo.drawer != rank_) continue;
    GS_CHECK(own.photos < DrawerStatus::kMostPhotos);
    own.of[own.photos++] = photo.report;
  }
  const auto status_of = [&](int rank) { return statuses_.data() + rank; };
  if (own.photos > 0)
    context_.launch("halt", write_status_kernel, 1, 1, status_of(rank_), halted, own);
  for (int other = 0; other < count_; ++other) {
    if (other == rank_) continue;
    if (own.photos > 0) sent.push_back({other, status_of(rank_), sizeof(DrawerStatus)});
    if (draws(photos, other)) received.push_back({other, status_of(other), sizeof(DrawerStatus)});
  }
}

void PhotoExchange::take_status(const std::vector<PhotoUnderWay>& photos,
                                std::uint32_t* halted) const {
  OtherReports others{};
  std::vector<int> so_far(std::size_t(count_), 0);
  for (const PhotoUnderWay& photo : photos) {
    const int among_its_own = so_far[std::size_t(photo.drawer)]++;
    if (photo.drawer == rank_) continue;
    GS_CHECK(others.photos < kMostBatch);
    others.of[others.photos++] = {photo.report, photo.number, photo.drawer, among_its_own};
  }
  if (others.photos > 0)
    context_.launch("halt", take_status_kernel, 1, 1, statuses_.data(), halted, others);
}

}  // namespace gs::cuda
