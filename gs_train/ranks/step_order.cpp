// SPDX-License-Identifier: Apache-2.0
#include "gs_train/ranks/step_order.h"

#include "gs_core/error.h"
#include "gs_train/ranks/shards.h"

namespace gs {
namespace {

struct PackedPhoto {
  std::uint64_t view, photo_row;
  RenderSettings settings;
  int reduction;
  bool is_refined;
  Camera refined;
};

// ---- what a shard is, besides its rows ---------------------------------------------------------

struct ShardHead {
  Deal deal;
  std::uint64_t rows, first_count;
  int adam_steps;
  MomentStorage moment_storage;
  bool has_time, has_filter, has_sums;
};

ShardHead head_of(const Deal& deal, const TrainingModel& shard) {
  const Gaussians& gaussians = shard.gaussians;
  return {deal,
          shard.count(),
          shard.first_count,
          shard.adam_steps,
          shard.moment_storage(),
          gaussians.has_time,
          gaussians.has_filter,
          shard.statistics.has_sums};
}

void take_shape(const ShardHead& head, TrainingModel& shard) {
  shard.gaussians.has_time = head.has_time;
  shard.gaussians.has_filter = head.has_filter;
  shard.store_moments_as(head.moment_storage);
  shard.statistics.has_sums = head.has_sums;
  shard.adam_steps = head.adam_steps;
  shard.first_count = std::size_t(head.first_count);
  take_shape_of(shard, std::size_t(head.rows), shard);
}

void pack_rows(Packer& packer, const TrainingModel& shard) {
  for_each_row_array(
      [&](const RowArray&, const auto& array) { packer.list(array.data(), array.size()); }, shard);
}

void unpack_rows(Unpacker& unpacker, TrainingModel& shard) {
  for_each_row_array(
      [&](const RowArray&, auto& array) {
        GS_CHECK(unpacker.count<std::remove_cvref_t<decltype(array[0])>>() == array.size());
        unpacker.values(array.data(), array.size());
      },
      shard);
}

// ---- of photos ---------------------------------------------------------------------------------

void pack(Packer& packer, const PhotometricState& state) {
  packer.value(state.shape);
  packer.value(state.adam_steps);
  packer.value(state.is_solved);
  for_each_photometric_array(
      [&](const char*, const auto& array) { packer.list(array.data(), array.size()); }, state);
}

void unpack(Unpacker& unpacker, PhotometricState& state) {
  state.shape = unpacker.value<PhotometricShape>();
  state.adam_steps = unpacker.value<int>();
  state.is_solved = unpacker.value<bool>();
  for_each_photometric_array(
      [&]<class T>(const char*, Buffer<T>& array) { array.upload(unpacker.list<T>()); }, state);
}

void pack(Packer& packer, const PoseState& state) {
  packer.value(state.adam_steps);
  packer.value(state.extent);
  packer.list(state.row_of);
  packer.list(state.frames);
  packer.list(state.centers);
  packer.value(state.common_modes.size());
  for (const std::vector<double>& mode : state.common_modes) packer.list(mode);
  for_each_pose_array([&](const char*, const auto& array) { packer.list(array); }, state);
}

void unpack(Unpacker& unpacker, PoseState& state) {
  state.adam_steps = unpacker.value<int>();
  state.extent = unpacker.value<double>();
  state.row_of = unpacker.list<std::uint32_t>();
  state.frames = unpacker.list<RigidFrame<double>>();
  state.centers = unpacker.list<Vec3d>();
  state.common_modes.resize(unpacker.value<std::size_t>());
  for (std::vector<double>& mode : state.common_modes) mode = unpacker.list<double>();
  for_each_pose_array(
      [&]<class T>(const char*, std::vector<T>& array) { array = unpacker.list<T>(); }, state);
}

}  // namespace

Message message_of(const StepOrder& order, const std::vector<View>& views) {
  GS_CHECK(!order.loss.appearance && !order.loss.photo_on_device);
  Packer packer;
  packer.value(order.loss);
  packer.value(order.update);
  packer.value(order.density);
  packer.value(order.photos.size());
  for (const TrainingPhoto& photo : order.photos) {
    const std::size_t view = std::size_t(photo.view - views.data());
    GS_CHECK(view < views.size());
    packer.value(PackedPhoto{view, photo.photo_row, photo.settings, photo.reduction,
                             photo.refined.has_value(), photo.camera()});
  }
  return packer.take();
}

StepOrder step_order_in(const Message& message, const std::vector<View>& views) {
  Unpacker unpacker(message);
  StepOrder order;
  order.loss = unpacker.value<LossSettings>();
  order.update = unpacker.value<Update>();
  order.density = unpacker.value<DensityStep>();
  for (auto left = unpacker.value<std::size_t>(); left > 0; --left) {
    const auto packed = unpacker.value<PackedPhoto>();
    GS_CHECK(packed.view < views.size());
    TrainingPhoto photo{&views[std::size_t(packed.view)], packed.settings, packed.reduction,
                        std::size_t(packed.photo_row)};
    if (packed.is_refined) photo.refined = packed.refined;
    order.photos.push_back(photo);
  }
  return order;
}

Message message_of(const Deal& deal, const TrainingModel& shard) {
  Packer packer;
  packer.value(head_of(deal, shard));
  pack_rows(packer, shard);
  pack(packer, shard.photometric);
  pack(packer, shard.poses);
  return packer.take();
}

DealtShard dealt_shard_in(const Message& message) {
  Unpacker unpacker(message);
  const auto head = unpacker.value<ShardHead>();
  DealtShard dealt;
  dealt.deal = head.deal;
  take_shape(head, dealt.shard);
  unpack_rows(unpacker, dealt.shard);
  unpack(unpacker, dealt.shard.photometric);
  unpack(unpacker, dealt.shard.poses);
  return dealt;
}

Message rows_of(const TrainingModel& shard) {
  Packer packer;
  pack_rows(packer, shard);
  return packer.take();
}

void take_rows(const Message& message, TrainingModel& shard) {
  Unpacker unpacker(message);
  unpack_rows(unpacker, shard);
}

}  // namespace gs
