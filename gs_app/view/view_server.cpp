// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/view_server.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <mutex>

#include "apps/web/pages.h"
#include "data_loaders/photos/encode/encode_jpeg.h"
#include "gs_core/error.h"
#include "gs_core/system/host_name.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/json.h"
#include "gs_eval/metrics.h"

namespace gs {
namespace {

constexpr int kPhotoQuality = 92;
constexpr const char* kJpeg = "image/jpeg";
constexpr std::string_view kPhotoPath = "/photo/";

HttpAnswer json_answer(const Json& json) {
  return http_text(json.dump(-1, ' ', false, Json::error_handler_t::replace), "application/json");
}

// Commands that the page prints work where the program was started. Others who look need not know
// where the model lies.
HttpAnswer scene_answer(ViewSource& source, const HttpRequest& request) {
  Json json = scene_json(source.scene());
  json.update(source.mode_and_model());
  const std::string& path = source.scene().path;
  if (!path.empty() && is_loopback(request.client)) json["path"] = path;
  return json_answer(json);
}

// state.json?after=STEP; without `after`, all losses are sent.
HttpAnswer state_answer(ViewSource& source, const HttpRequest& request) {
  int after_step = -1;
  if (const auto word = request.query.find("after"); word != request.query.end()) {
    const std::string& text = word->second;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), after_step);
    if (error != std::errc() || end != text.data() + text.size())
      return http_error(400, "/state.json cannot use `after`: it is not a step");
  }
  return json_answer(source.state(after_step));
}

// Decodes one photo at a time, so that a run needs little memory for them.
Image8 shown_alone(const View& view, const Vec3f& background) {
  static std::mutex one_at_a_time;
  const std::lock_guard lock(one_at_a_time);
  return shown_photo(*with_photo(view), background);
}

// The page has 3 MB, which all answers share.
HttpAnswer page_answer() {
  static const auto page = std::make_shared<const std::string>(view_page());
  HttpAnswer answer;
  answer.type = "text/html; charset=utf-8";
  answer.body = page;
  return answer;
}

HttpAnswer photo_answer(const ViewScene& scene, std::string_view number) {
  std::size_t index = 0;
  const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), index);
  if (error != std::errc() || end != number.data() + number.size() ||
      index >= scene.cameras.size() || !scene.cameras[index].view)
    return http_error(404, "there is no such photo");
  const View& view = *scene.cameras[index].view;
  try {
    const auto jpeg = encode_jpeg(shown_alone(view, scene.background), kPhotoQuality);
    return http_text(std::string(jpeg.begin(), jpeg.end()), kJpeg);
  } catch (const Error& error) {
    log_warning("the viewer has no photo of {}: {}", printable(view.name), error.what());
    return http_error(500, fmt::format("the photo {} cannot be shown; the messages of the program "
                                       "say why",
                                       printable(view.name)));
  }
}

HttpAnswer mesh_answer(const ViewScene& scene) {
  if (scene.mesh.empty()) return http_error(404, "there is no mesh; `gemsplat mesh` makes it");
  HttpAnswer answer;
  answer.type = "model/gltf-binary";
  answer.file = scene.mesh;
  return answer;
}

}  // namespace

HttpAnswer ViewSource::frame(const HttpRequest&) {
  return http_error(404, "only `gemsplat view --remote` renders frames");
}

HttpAnswer ViewSource::control(const HttpRequest&) {
  return http_error(404, "only a run that trains can be controlled");
}

Json finished_state(std::size_t gaussians) {
  return {{"step", 0},
          {"steps", 0},
          {"loss", nullptr},
          {"losses", Json::array()},
          {"gaussians", gaussians},
          {"psnr", nullptr},
          {"seconds", 0},
          {"version", 1},
          {"done", true},
          {"stopped", false},
          {"message", ""}};
}

HttpAnswer view_answer(ViewSource& source, const HttpRequest& request) {
  const std::string& path = request.path;
  if (request.method == "POST")
    return path == "/control" ? source.control(request)
                              : http_error(404, "there is nothing at this address");
  if (path == "/") return page_answer();
  if (path == "/scene.json") return scene_answer(source, request);
  if (path == "/state.json") return state_answer(source, request);
  if (path == "/model") return source.model();
  if (path == "/mesh") return mesh_answer(source.scene());
  if (path == "/frame") return source.frame(request);
  if (path.starts_with(kPhotoPath))
    return photo_answer(source.scene(), std::string_view(path).substr(kPhotoPath.size()));
  return http_error(404, "there is nothing at this address");
}

bool can_view() { return !view_page().empty(); }

std::string cannot_view() {
  return "this build has no viewer page, because npm was missing: install npm and build again";
}

void check_can_view() {
  if (!can_view()) throw Error(cannot_view());
}

void warn_if_public(const HttpPlace& place, int port) {
  if (is_loopback(place.host)) return;
  log_warning(
      "other machines can reach {}: everyone who opens the viewer there sees the model and the "
      "photos",
      place.host);
  if (place.host != "0.0.0.0" && place.host != "::") return;
  for (const std::string& address : own_addresses())
    log_info("from another machine or a phone: http://{}:{}/", address, port);
}

}  // namespace gs
