// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checkpoints/checkpoint_file.h"

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>

#include "gs_core/config/config_fields.h"
#include "gs_core/config/config_text.h"
#include "gs_core/error.h"
#include "gs_core/io/checked_file.h"
#include "gs_core/version.h"

namespace gs {
namespace {

constexpr FileKind kKind{"gsckpt\r\n", 1};
constexpr std::size_t kChunkBytes = std::size_t(1) << 24;  // copied from a device at once

// ---- the config, a line per field --------------------------------------------------------------

std::string text_of(const Config& config) {
  std::string text;
  visit_fields(config, [&](const auto& field) {
    text += fmt::format("{} = {}\n", field.key, toml_text(field.value));
  });
  return text;
}

Config config_of(const std::string& text) {
  Config config;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    apply_setting(config, text.substr(begin, end - begin));
    begin = end + 1;
  }
  return config;
}

// ---- numbers that people may want to read ------------------------------------------------------

nlohmann::ordered_json about(const RunProgress& progress, const TrainingModel& model,
                             const SceneRecord& scene) {
  return {{"gemsplat", kVersion},
          {"step", progress.step},
          {"gaussians", model.count()},
          {"adam_steps", model.adam_steps},
          {"sh_degree", progress.sh_degree},
          {"loss", progress.loss},
          {"train_seconds", progress.train_seconds},
          {"growth_cap", progress.growth_cap},
          {"extent", scene.extent},
          {"world_offset", {scene.world_offset.x, scene.world_offset.y, scene.world_offset.z}}};
}

// ---- views -------------------------------------------------------------------------------------

struct ViewNumbers {
  std::int32_t is_test, width, height;
  float fx, fy, cx, cy;
  Mat3<float> rotation;
  Vec3f translation, exposure;
};
static_assert(sizeof(ViewNumbers) == 22 * 4);

ViewNumbers numbers_of(const ViewRecord& view) {
  const Camera& camera = view.camera;
  return {view.is_test,
          camera.width,
          camera.height,
          camera.fx,
          camera.fy,
          camera.cx,
          camera.cy,
          camera.cam_from_world_rotation,
          camera.cam_from_world_translation,
          view.exposure};
}

ViewRecord view_of(const ViewNumbers& numbers) {
  ViewRecord view;
  view.is_test = numbers.is_test != 0;
  view.exposure = numbers.exposure;
  Camera& camera = view.camera;
  camera.width = numbers.width;
  camera.height = numbers.height;
  camera.fx = numbers.fx;
  camera.fy = numbers.fy;
  camera.cx = numbers.cx;
  camera.cy = numbers.cy;
  camera.cam_from_world_rotation = numbers.rotation;
  camera.cam_from_world_translation = numbers.translation;
  return view;
}

void write_views(CheckedWriter& file, const std::vector<ViewRecord>& views) {
  std::string names;
  for (const ViewRecord& view : views) names += view.name + '\0';
  file.text("view_names", names);
  file.section("views", views.size() * sizeof(ViewNumbers));
  for (const ViewRecord& view : views) {
    const ViewNumbers numbers = numbers_of(view);
    file.write(&numbers, sizeof numbers);
  }
}

std::vector<ViewRecord> read_views(CheckedReader& file) {
  const std::string names = file.text("view_names");
  std::vector<ViewRecord> views;
  std::size_t begin = 0;
  for (const ViewNumbers& numbers : file.values<ViewNumbers>("views")) {
    const std::size_t end = names.find('\0', begin);
    if (end == names.npos) file.damaged();
    views.push_back(view_of(numbers));
    views.back().name = names.substr(begin, end - begin);
    begin = end + 1;
  }
  return views;
}

// ---- arrays ------------------------------------------------------------------------------------

template <class T>
void write_array(CheckedWriter& file, const std::string& name, const T* data, std::size_t count,
                 Memory& memory) {
  std::size_t bytes = count * sizeof(T);
  file.section(name, bytes);
  if (&memory == &host_memory()) return file.write(data, bytes);
  std::vector<std::byte> chunk(std::min(bytes, kChunkBytes));
  for (const auto* at = reinterpret_cast<const std::byte*>(data); bytes > 0;) {
    const std::size_t some = std::min(bytes, chunk.size());
    memory.download(chunk.data(), at, some);
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

void read_model(CheckedReader& file, std::size_t count, TrainingModel& model) {
  for_each_row_array(
      [&](const RowArray& which, auto& array) {
        const std::size_t row = sizeof(*array.data());
        const std::uint64_t bytes = file.section(which.key());
        if (bytes / row != count || bytes % row) file.damaged();
        array.resize_discard(count);
        file.read(array.data(), bytes);
      },
      model);
}

// The texts of a file. They are parsed only after its checksum was found right.
struct Contents {
  std::string about, config;
};

void apply(const Contents& contents, Checkpoint& checkpoint) {
  const auto json = nlohmann::json::parse(contents.about);
  RunProgress& progress = checkpoint.state.progress;
  progress.step = json.at("step");
  progress.sh_degree = json.at("sh_degree");
  progress.loss = json.at("loss");
  progress.train_seconds = json.at("train_seconds");
  progress.growth_cap = json.at("growth_cap");
  checkpoint.state.model.adam_steps = json.at("adam_steps");
  checkpoint.scene.extent = json.at("extent");
  for (int k = 0; k < 3; ++k) checkpoint.scene.world_offset[k] = json.at("world_offset").at(k);
  checkpoint.config = config_of(contents.config);
}

}  // namespace

SceneRecord::SceneRecord(const Scene& scene)
    : extent(scene.extent), world_offset(scene.world_offset) {
  for (const View& view : scene.train_views)
    views.push_back({view.name, false, view.camera, view.exposure});
  for (const View& view : scene.test_views)
    views.push_back({view.name, true, view.camera, view.exposure});
}

std::uint64_t checkpoint_bytes(std::size_t gaussians, std::size_t views) {
  std::uint64_t row = 0;
  const TrainingModel none;
  for_each_row_array([&](const RowArray&, const auto& array) { row += sizeof(*array.data()); },
                     none);
  return gaussians * row + views * 512;
}

void write_checkpoint(const std::filesystem::path& path, const Config& config,
                      const SceneRecord& scene, const RunProgress& progress,
                      const TrainingModel& model) {
  CheckedWriter file(path, kKind);
  file.text("about", about(progress, model, scene).dump());
  file.text("config", text_of(config));
  write_views(file, scene.views);
  write_values(file, "strikes", progress.strikes);
  write_values(file, "view_order", progress.view_order);
  const std::uint64_t count = model.count();
  write_values(file, "gaussians", std::vector<std::uint64_t>{count});
  for_each_row_array(
      [&](const RowArray& which, const auto& array) {
        write_array(file, which.key(), array.data(), array.size(), array.memory());
      },
      model);
  file.commit();
}

Checkpoint read_checkpoint(const std::filesystem::path& path) {
  CheckedReader file(path, kKind);
  Checkpoint checkpoint;
  Contents contents;
  contents.about = file.text("about");
  contents.config = file.text("config");
  checkpoint.scene.views = read_views(file);
  checkpoint.state.progress.strikes = file.values<int>("strikes");
  checkpoint.state.progress.view_order = file.values<std::uint32_t>("view_order");
  const auto count = file.values<std::uint64_t>("gaussians");
  if (count.size() != 1) file.damaged();
  read_model(file, count[0], checkpoint.state.model);
  file.finish();
  try {
    apply(contents, checkpoint);
  } catch (const std::exception& error) {  // whole, but of another version
    cannot_read(path, std::string("it is of another version of gemsplat: ") + error.what());
  }
  return checkpoint;
}

}  // namespace gs
