// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checkpoints/checkpoint_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

#include "gs_app/checkpoints/checkpoint_about.h"
#include "gs_app/checkpoints/checkpoint_views.h"
#include "gs_core/config/text/setting_lines.h"
#include "gs_core/error.h"
#include "gs_core/system/files/checked_file.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

// Version 1 had first and second moments as floats in arrays of their own.
constexpr FileKind kKind{"gsckpt\r\n", 1, 2};
constexpr std::size_t kChunkBytes = std::size_t(1) << 24;  // copied from a device at once

// Behind the count of Gaussians, unless it is 0: which arrays there are besides the usual ones.
constexpr std::uint64_t kHasTime = 1;          // those of space and time
constexpr std::uint64_t kHasSums = 2;          // sums over fragments, of density control
constexpr std::uint64_t kHasFilter = 4;        // that of the 3D filter
constexpr std::uint64_t kHasPhotometric = 16;  // those of a photometric model, which are no rows
constexpr std::uint64_t kHasPoses = 32;        // those of poses, which are no rows either
constexpr std::uint64_t kHasHalves = 256;      // HalfMoments in place of FloatMoments
constexpr std::uint64_t kHasLenses = 512;      // those of the views

// Kinds that older versions wrote.
struct RemovedKind {
  std::uint64_t bit;
  const char* what;
};
constexpr RemovedKind kRemovedKinds[] = {
    {8, "colors that change in time (model.time_colors)"},
    {64, "moments in 32 bits (optimizer.moments = \"compact\")"},
    {128, "updates of SH that were left for later (optimizer.lazy)"},
};

std::uint64_t kind_of(const TrainingModel& model) {
  return (model.gaussians.has_time ? kHasTime : 0) | (model.statistics.has_sums ? kHasSums : 0) |
         (model.gaussians.has_filter ? kHasFilter : 0) |
         (model.photometric.empty() ? 0 : kHasPhotometric) | (model.poses.empty() ? 0 : kHasPoses) |
         (model.moment_storage() == MomentStorage::halves ? kHasHalves : 0);
}

void set_kind(TrainingModel& model, std::uint64_t kind) {
  model.gaussians.has_time = kind & kHasTime;
  model.store_moments_as(kind & kHasHalves ? MomentStorage::halves : MomentStorage::floats);
  model.match_moments();
  model.statistics.has_sums = kind & kHasSums;
  model.gaussians.has_filter = kind & kHasFilter;
}

bool is_kind(std::uint64_t kind) {
  constexpr std::uint64_t kKnown =
      kHasTime | kHasSums | kHasFilter | kHasPhotometric | kHasPoses | kHasHalves | kHasLenses;
  return (kind & ~kKnown) == 0;
}

// ---- arrays ------------------------------------------------------------------------------------

void write_rows(CheckedWriter& file, const std::string& name, const ByteBuffer& rows) {
  std::size_t bytes = rows.size_bytes();
  file.section(name, bytes);
  if (&rows.memory() == &host_memory()) return file.write(rows.bytes(), bytes);
  std::vector<std::byte> chunk(std::min(bytes, kChunkBytes));
  for (const std::byte* at = rows.bytes(); bytes > 0;) {
    const std::size_t some = std::min(bytes, chunk.size());
    rows.memory().download(chunk.data(), at, some);
    file.write(chunk.data(), some);
    at += some;
    bytes -= some;
  }
}

template <class T>
void write_values(CheckedWriter& file, const std::string& name, const std::vector<T>& values) {
  file.section(name, values.size() * sizeof(T));
  file.write(values.data(), values.size() * sizeof(T));
}

// Sums as checkpoints had them until November 2026, with the weights of the fragments.
void read_older_sums(CheckedReader& file, Buffer<FragmentSums>& sums) {
  std::vector<Vec4f> rows(sums.size());
  file.read(rows.data(), rows.size() * sizeof(Vec4f));
  for (std::size_t i = 0; i < rows.size(); ++i) sums[i] = {rows[i].x, rows[i].z, rows[i].w};
}

// What version 1 called the arrays of first and of second moments.
constexpr std::pair<const char*, float FloatMoments::*> kSplitMoments[] = {
    {"first_moment", &FloatMoments::first}, {"second_moment", &FloatMoments::second}};

void take_split(const std::vector<float>& values, float FloatMoments::*moment,
                Span<FloatMoments> pairs) {
  for (std::size_t i = 0; i < values.size(); ++i) pairs[i].*moment = values[i];
}

void read_split_moments(CheckedReader& file, std::size_t count, const Columns& moments) {
  for (const auto& [group, moment] : kSplitMoments)
    for (const Column& column : moments) {
      const std::size_t in_row = column.rows->row_bytes() / sizeof(FloatMoments);
      const auto values = file.values<float>(group + std::string(".") + column.name);
      if (values.size() / in_row != count || values.size() % in_row) file.damaged();
      column.rows->resize(count);
      take_split(values, moment,
                 {reinterpret_cast<FloatMoments*>(column.rows->bytes()), values.size()});
    }
}

// So many numbers of photos.
template <class T>
std::vector<T> read_values(CheckedReader& file, const std::string& name, std::size_t count) {
  std::vector<T> values = file.values<T>(name);
  if (values.size() != count) file.damaged();
  return values;
}

// An array of photos, whose name is GROUP.values, GROUP.moments or GROUP.start.
template <class T>
std::vector<T> read_of_photos(CheckedReader& file, const std::string& name, std::size_t count) {
  if constexpr (std::is_same_v<T, FloatMoments>) {
    if (file.version() == 1) {
      std::vector<T> pairs;
      for (const auto& [split, moment] : kSplitMoments) {
        const std::string group = name.substr(0, name.find('.') + 1);
        const std::vector<float> values = read_values<float>(file, group + split, count);
        pairs.resize(count);
        take_split(values, moment, {pairs.data(), count});
      }
      return pairs;
    }
  }
  return read_values<T>(file, name, count);
}

void read_model(CheckedReader& file, std::size_t count, TrainingModel& model) {
  const bool is_split = file.version() == 1 && model.moment_storage() == MomentStorage::floats;
  Columns split;
  for (const Column& column : model.columns()) {
    if (is_split && column.role == RowRole::moment) {
      split.push_back(column);
      continue;
    }
    if (column.role == RowRole::statistic)  // split moments come before the first of these
      read_split_moments(file, count, std::exchange(split, {}));
    ByteBuffer& rows = *column.rows;
    const std::uint64_t bytes = file.section(column.key());
    const bool is_older = &rows == &model.statistics.sums && bytes == count * sizeof(Vec4f);
    if (!is_older && (bytes / rows.row_bytes() != count || bytes % rows.row_bytes()))
      file.damaged();
    rows.resize_discard(count);
    if (is_older)
      read_older_sums(file, model.statistics.sums);
    else
      file.read(rows.bytes(), bytes);
  }
}

void write_photometric(CheckedWriter& file, const PhotometricState& state) {
  write_values(
      file, "photometric",
      // Two that older versions had of cameras are 0.
      std::vector<std::uint32_t>{state.rows, state.numbers, 0, 0, std::uint32_t(state.adam_steps),
                                 std::uint32_t(state.is_solved)});
  for_each_photometric_array(
      [&](const char* name, const auto& array) { write_rows(file, name, array); }, state);
}

[[noreturn]] void refuse_removed(const std::filesystem::path& path, const char* what) {
  cannot_read(path, fmt::format("it has {}, which this version does not have any more; go on with "
                                "the version that wrote it, or start from its model with --from",
                                what));
}

void read_photometric(const std::filesystem::path& path, CheckedReader& file,
                      PhotometricState& state) {
  constexpr std::uint32_t kMost = 1u << 31, kMostNumbers = 1024;  // of a photo or camera
  const auto shape = file.values<std::uint32_t>("photometric");
  if (shape.size() != 6 || shape[0] > kMost || shape[1] > kMostNumbers || shape[2] > kMost ||
      shape[3] > kMostNumbers || shape[4] > std::uint32_t(kMostSteps))
    file.damaged();
  if (shape[2] > 0 && shape[3] > 0) refuse_removed(path, "vignetting that is learned");
  if (shape[1] > kMostPhotoNumbers) refuse_removed(path, "a photometric model of more numbers");
  state.rows = shape[0];
  state.numbers = shape[1];
  state.adam_steps = int(shape[4]);
  state.is_solved = shape[5] != 0;
  for_each_photometric_array(
      [&]<class T>(const char* name, Buffer<T>& array) {
        array.upload(read_of_photos<T>(file, name, state.size()));
      },
      state);
}

void write_poses(CheckedWriter& file, const PoseState& state) {
  write_values(file, "poses",
               std::vector<std::uint32_t>{state.rows, std::uint32_t(state.adam_steps)});
  for_each_pose_array([&](const char* name, const auto& array) { write_rows(file, name, array); },
                      state);
}

void read_poses(CheckedReader& file, PoseState& state) {
  constexpr std::uint32_t kMostRows = 1u << 28;
  const auto numbers = file.values<std::uint32_t>("poses");
  if (numbers.size() != 2 || numbers[0] > kMostRows || numbers[1] > std::uint32_t(kMostSteps))
    file.damaged();
  state.rows = numbers[0];
  state.numbers = std::uint32_t(kPoseNumbers);
  state.adam_steps = int(numbers[1]);
  for_each_pose_array(
      [&]<class T>(const char* name, Buffer<T>& array) {
        array.upload(read_of_photos<T>(file, name, state.size()));
      },
      state);
  state.start.upload(std::vector<float>(state.size(), 0.0f));
}

void check(const std::filesystem::path& path, const Checkpoint& checkpoint) {
  constexpr int kMostStrikes = 1000;  // far above those after which a view is skipped
  constexpr const char* kRemedy = "the checkpoint is forged, resume another one";
  for (const ViewRecord& view : checkpoint.scene.views)
    if (!is_sound(view))
      cannot_read(path, fmt::format("the camera of {} has numbers that no camera has; {}",
                                    shown_word(view.name), kRemedy));
  for (const float value : checkpoint.state.model.photometric.values)
    if (!std::isfinite(value))
      cannot_read(path, fmt::format("a number of photometric.model is not finite; {}", kRemedy));
  for (const float value : checkpoint.state.model.poses.values)
    if (!std::isfinite(value))
      cannot_read(path, fmt::format("a number of a refined pose is not finite; {}", kRemedy));
  for (const int strikes : checkpoint.state.progress.strikes)
    if (strikes < 0 || strikes > kMostStrikes)
      cannot_read(path, fmt::format("a view is counted {} breakdowns; {}", strikes, kRemedy));
}

// What stands behind the texts.
void read_views_and_arrays(const std::filesystem::path& path, CheckedReader& file,
                           Checkpoint& checkpoint) {
  checkpoint.scene.views = read_views(file);
  checkpoint.state.progress.strikes = file.values<int>("strikes");
  checkpoint.state.progress.view_order = file.values<std::uint32_t>("view_order");
  const auto count = file.values<std::uint64_t>("gaussians");
  const std::uint64_t kind = count.size() == 2 ? count[1] : 0;
  for (const RemovedKind& removed : kRemovedKinds)
    if (kind & removed.bit) refuse_removed(path, removed.what);
  if (!(count.size() == 1 || (kind > 0 && is_kind(kind)))) file.damaged();
  set_kind(checkpoint.state.model, kind);
  if (kind & kHasTime) read_times(file, checkpoint.scene.views);
  if (kind & kHasLenses) read_lenses(file, checkpoint.scene.views);
  read_model(file, count[0], checkpoint.state.model);
  if (kind & kHasPhotometric) read_photometric(path, file, checkpoint.state.model.photometric);
  if (kind & kHasPoses) read_poses(file, checkpoint.state.model.poses);
  file.finish();
}

}  // namespace

SceneRecord::SceneRecord(const Scene& scene)
    : extent(scene.extent), world_offset(scene.world_offset) {
  for (const View& view : scene.train_views)
    views.push_back({view.name, false, view.camera, view.exposure});
  for (const View& view : scene.test_views)
    views.push_back({view.name, true, view.camera, view.exposure});
}

std::uint64_t checkpoint_bytes(const TrainingModel& model, std::size_t views) {
  std::uint64_t row = 0;
  for (const auto& column : model.columns()) row += column.rows->row_bytes();
  return model.count() * row + views * 512;
}

void write_checkpoint(const std::filesystem::path& path, const Config& config,
                      const SceneRecord& scene, const RunProgress& progress,
                      const TrainingModel& model) {
  CheckedWriter file(path, kKind);
  file.text("about", about_text(progress, model, scene));
  file.text("config", setting_lines(config));
  write_views(file, scene.views);
  write_values(file, "strikes", progress.strikes);
  write_values(file, "view_order", progress.view_order);
  const std::uint64_t kind = kind_of(model) | (have_lenses(scene.views) ? kHasLenses : 0);
  std::vector<std::uint64_t> count_and_kind{model.count()};
  if (kind) count_and_kind.push_back(kind);
  write_values(file, "gaussians", count_and_kind);
  if (kind & kHasTime) write_times(file, scene.views);
  if (kind & kHasLenses) write_lenses(file, scene.views);
  for (const auto& column : model.columns()) write_rows(file, column.key(), *column.rows);
  if (kind & kHasPhotometric) write_photometric(file, model.photometric);
  if (kind & kHasPoses) write_poses(file, model.poses);
  file.commit();
}

Checkpoint read_checkpoint(const std::filesystem::path& path, CheckpointPart part) {
  CheckedReader file(path, kKind);
  Checkpoint checkpoint;
  // They are parsed only after the file's checksum was found right.
  const std::string about = file.text("about"), config = file.text("config");
  if (part == CheckpointPart::whole) read_views_and_arrays(path, file, checkpoint);
  try {
    take_about(path, about, checkpoint);
    checkpoint.config = config_of_lines(config);
  } catch (const UsageError& error) {  // whole, but with a setting that this version does not have
    cannot_read(path, std::string("it is of another version of gemsplat: ") + error.what());
  }
  check(path, checkpoint);
  return checkpoint;
}

}  // namespace gs
