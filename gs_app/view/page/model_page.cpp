// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/page/model_page.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>

#include "apps/web/pages.h"
#include "gs_app/export/export_model.h"
#include "gs_app/run/page_text.h"
#include "gs_app/run/text.h"
#include "gs_app/view/file_view.h"
#include "gs_app/view/served_model.h"
#include "gs_app/view/view_server.h"
#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/text/ascii.h"
#include "gs_core/system/text/json.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/formats/formats.h"
#include "gs_render/paths/camera_path.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Of apps/web/view/page.html.
constexpr std::string_view kBody = "<div id=\"app\">", kTitle = "<title>gemsplat view</title>";
constexpr double kElevation = 20;  // degrees: of the turn around a model without cameras
constexpr double kOutside = 2.5;   // times the model's radius: the distance of that turn

// The page asks its server for scene.json and model; this answers from the two elements before it.
// The text of the model is given up when it was read.
constexpr std::string_view kAnswers = R"js(<script>
(() => {
  const element = name => document.getElementById(`gemsplat-${name}`);
  const bytesOfModel = () => {
    const text = atob(element('model').textContent), bytes = new Uint8Array(text.length);
    element('model').remove();
    for (let i = 0; i < bytes.length; ++i) bytes[i] = text.charCodeAt(i);
    return bytes;
  };
  const ask = window.fetch.bind(window);
  window.fetch = async (address, options) => {
    const name = typeof address === 'string' ? address.split('?')[0] : '';
    if (name === 'scene.json') return new Response(element('scene').textContent);
    if (name === 'model') return new Response(bytesOfModel());
    return ask(address, options);
  };
})();
</script>
)js";

/// The format of the model inside, and how it is written.
struct Inside {
  const ModelFormat* format;
  ExportOptions options;
};

Inside inside_of(const GaussianModel& model) {
  if (model.gaussians.has_time) return {&format_named("gs4d"), {}};
  try {
    format_named("sog").require({});
    return {&format_named("sog"), {}};
  } catch (const Error&) {  // without libwebp
    return {&format_named("spz"), {.spz_version = 3, .spz_sh_bits = 8}};
  }
}

/// The scene without photos, which would not fit, and without notes about them.
ViewScene scene_of(const OpenedModel& opened, Config config) {
  config.dataset.source.clear();
  ViewScene scene = view_scene_of(opened, config, false, "");
  scene.notes.clear();
  return scene;
}

/// Whether the scene's folder has a name of its own. That of `train PHOTOS` is OUT/scene.
bool knows_scene_by_name(const OpenedModel& opened, const Config& config) {
  if (config.dataset.source.empty()) return false;
  std::error_code ignored;
  const fs::path above = fs::absolute(config.dataset.source).lexically_normal().parent_path();
  return !opened.run || !fs::equivalent(above, opened.run->root(), ignored);
}

/// The circle on which the page begins: the middle of the arc from which photos were taken, and its
/// width in radians. Inside of walls, which a circle would cross, it is a short arc.
Json turn_json(const ViewScene& scene) {
  SceneFrame frame = scene.frame;
  CameraArc arc;
  if (scene.eye) return {{"middle", list_of(*scene.eye)}, {"width", 0}};
  if (scene.cameras.empty()) {
    frame.radius *= kOutside;
    frame.elevation = kElevation;
    arc = arc_of_cameras(frame, {});
  } else {
    std::vector<CameraPose> poses;
    for (const ViewedCamera& viewed : scene.cameras) poses.push_back(pose_of(viewed.camera));
    arc = arc_of_cameras(frame, poses);
  }
  Orbit circle{frame, 1, arc.middle};
  return {{"middle", list_of(orbit(circle, 1).front().position)}, {"width", arc.width}};
}

void check_size(const fs::path& file, std::uint64_t bytes, const ModelFormat& format) {
  if (bytes <= kMostPageModelBytes) return;
  throw Error(fmt::format(
      "cannot write {}: the model takes {} MB as {}, and a page holds {} MB at most, since "
      "browsers "
      "keep it in memory several times; shrink it with `gemsplat edit --decimate` or a lower "
      "--sh-degree, or let viewers stream it as a .rad",
      file.string(), bytes / 1'000'000, format.ending, kMostPageModelBytes / 1'000'000));
}

}  // namespace

bool is_model_page(const fs::path& file) { return lowercase(file.extension().string()) == ".html"; }

void check_model_page(const fs::path& file, bool force) {
  check_can_view();
  check_place(file, force);
}

ModelPage write_model_page(const fs::path& file, const OpenedModel& opened, const Config& config,
                           int sh_degree, const std::string& title) {
  const OutputLock lock = OutputLock::of_file(file);
  const Inside inside = inside_of(opened.model);
  MemorySink packed(file.string());
  GaussianModel model =
      host_copy(opened.model.gaussians, opened.model.sh_degree, opened.model.antialiased);
  limit_sh_degree(model, sh_degree);
  ModelPage page{file, 0, 0, inside.format->ending, 0};
  page.gaussians = write_model(packed, *inside.format, model, inside.options);
  page.model_bytes = packed.text.size();
  check_size(file, page.model_bytes, *inside.format);

  ViewScene scene = scene_of(opened, config);
  if (knows_scene_by_name(opened, config)) scene.title = name_of(config.dataset.source);
  if (!title.empty()) scene.title = title;
  Json json = scene_json(scene);
  json["mode"] = "file";
  json["visitors"] = true;
  json["turn"] = turn_json(scene);
  json["model"] = model_json(*inside.format, scene.title, page.gaussians, page.model_bytes,
                             model.sh_degree, model.antialiased);
  const std::string_view viewer = view_page();
  const std::size_t body = viewer.find(kBody), name = viewer.find(kTitle);
  GS_CHECK(body != viewer.npos && name < body);
  const std::size_t after_name = name + kTitle.size();
  keep_older_aside(file);
  AtomicFile output(file);
  output.write(viewer.substr(0, name));
  output.write("<title>" + html_text(scene.title) + "</title>");
  output.write(viewer.substr(after_name, body - after_name));
  output.write("<script id=\"gemsplat-scene\" type=\"application/json\">");
  output.write(script_json(json));
  output.write("</script>\n<script id=\"gemsplat-model\" type=\"text/plain\">");
  output.write(base64_of({packed.text.begin(), packed.text.end()}));
  output.write("</script>\n");
  output.write(kAnswers);
  output.write(viewer.substr(body));
  output.commit();
  page.bytes = fs::file_size(file);
  return page;
}

std::string summary(const ModelPage& page) {
  return fmt::format("{}: {:.1f} MB, with {:.1f} MB of {} for {} Gaussians; a browser opens it",
                     page.file.string(), double(page.bytes) / 1e6, double(page.model_bytes) / 1e6,
                     page.format, with_commas(page.gaussians));
}

}  // namespace gs
