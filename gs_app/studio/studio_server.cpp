// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/studio_server.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>

#include "apps/web/pages.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_app/studio/masks.h"
#include "gs_app/studio/thumbnails.h"
#include "gs_app/view/http/secret.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestBody = std::size_t(4) << 20;  // bytes: a piece of an upload

HttpAnswer json_said(const Json& json) {
  return http_text(json.dump(-1, ' ', false, Json::error_handler_t::replace), "application/json");
}

std::string word_in(const HttpRequest& request, const char* name) {
  const auto at = request.query.find(name);
  return at == request.query.end() ? std::string() : at->second;
}

std::uint64_t number_in(const HttpRequest& request, const char* name) {
  const std::string text = word_in(request, name);
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size())
    throw UsageError(fmt::format("{} is to be a number", name));
  return value;
}

Json body_of(const HttpRequest& request) {
  if (request.body.empty()) return Json::object();
  return parse_json("the request", request.body, "load the page again");
}

std::vector<std::string> words_of(const Json& body) {
  return take_from_json("the request", "load the page again",
                        [&] { return body.at("words").get<std::vector<std::string>>(); });
}

Json json_of(const UploadState& state) {
  return {{"bytes", state.bytes}, {"is_whole", state.is_whole}};
}

// A page that a stranger's file may hold has no rights here, and what a browser does not show itself
// is saved.
HttpAnswer file_answer(const fs::path& folder, const std::string& name) {
  const fs::path file = folder / safe_path(name);
  if (!is_file(file) || !is_within(file, folder)) throw UsageError("there is no such file");
  static const std::map<std::string, std::string> kTypes = {{".jpg", "image/jpeg"},
                                                            {".png", "image/png"},
                                                            {".mp4", "video/mp4"},
                                                            {".html", "text/html; charset=utf-8"},
                                                            {".log", "text/plain; charset=utf-8"}};
  HttpAnswer answer;
  answer.file = file;
  const auto type = kTypes.find(lowercase_ending(file));
  answer.type = type == kTypes.end() ? "application/octet-stream" : type->second;
  if (type == kTypes.end()) answer.headers.emplace_back("Content-Disposition", "attachment");
  answer.headers.emplace_back("Content-Security-Policy", "sandbox allow-scripts allow-downloads");
  return answer;
}

// By how much the page shows a photo turned; 0 where it does not say.
int turn_in(const HttpRequest& request) {
  const std::uint64_t degrees = request.query.contains("turn") ? number_in(request, "turn") : 0;
  if (degrees >= 360 || !is_turn(int(degrees)))
    throw UsageError("turn is to be 0, 90, 180 or 270 degrees");
  return int(degrees);
}

HttpAnswer thumbnail_answer(const Project& project, const HttpRequest& request) {
  const bool is_large = request.query.contains("large");
  HttpAnswer answer;
  answer.type = "image/jpeg";
  answer.file = thumbnail_of(project, word_in(request, "name"),
                             {turn_in(request), is_large ? kLongestMaskSide : kThumbnailSide});
  return answer;
}

HttpAnswer mask_answer(const Project& project, const HttpRequest& request) {
  const std::vector<std::uint8_t> png =
      encode_png(mask_as_seen(project, word_in(request, "name"), turn_in(request)));
  return http_text({png.begin(), png.end()}, "image/png");
}

HttpAnswer studio_page_answer() {
  static const auto page = std::make_shared<const std::string>(studio_page());
  HttpAnswer answer;
  answer.type = "text/html; charset=utf-8";
  answer.headers.emplace_back("Referrer-Policy", "no-referrer");
  answer.body = page;
  return answer;
}

// "a/b/c" -> "a", and "b/c" stays.
std::string take_part(std::string& path) {
  const std::size_t slash = std::min(path.find('/'), path.size());
  std::string part = path.substr(0, slash);
  path.erase(0, std::min(slash + 1, path.size()));
  return part;
}

}  // namespace

bool has_studio_page() { return !studio_page().empty(); }

HttpLimits StudioServer::limits() const {
  HttpLimits limits;
  limits.body_bytes = kLongestBody;
  limits.may_send_body = [this](const HttpRequest& request) { return knows_secret(request); };
  return limits;
}

bool StudioServer::knows_secret(const HttpRequest& request) const {
  return is_same_secret(request.path.substr(0, start_.size()), start_);
}

HttpAnswer StudioServer::answer(const HttpRequest& request) {
  if (!knows_secret(request))
    return http_error(403, "open the address that gemsplat studio printed; it has a secret");
  try {
    return answer_below(request, request.path.substr(start_.size()));
  } catch (const Error& error) {
    return http_error(400, error.what());
  } catch (const fs::filesystem_error& error) {
    return http_error(400, error.code().message() + ": " + error.path1().string());
  }
}

HttpAnswer StudioServer::answer_below(const HttpRequest& request, const std::string& path) {
  std::string rest = path;
  const std::string what = take_part(rest);
  if (path.empty()) return studio_page_answer();
  if (what == "p") {
    const std::string id = take_part(rest);
    return request.method == "POST" && !rest.starts_with("live/")
               ? post_to_project(request, id, rest)
               : of_project(request, id, rest);
  }
  if (what == "view") {
    int port = 0;
    const std::string digits = take_part(rest);
    std::from_chars(digits.data(), digits.data() + digits.size(), port);
    if (!viewers_.has(port)) return http_error(404, "this view has ended; open it again");
    return forwarded(port, request, "/" + rest);
  }
  if (path == "state") return json_said(studio_.state());
  if (path == "new" && request.method == "POST")
    return json_said(
        {{"id", studio_.create(word_in(request, "name"), word_in(request, "photos"))}});
  return http_error(404, "there is nothing at this address");
}

HttpAnswer StudioServer::of_project(const HttpRequest& request, const std::string& id,
                                    const std::string& what) {
  if (what.empty()) return json_said(studio_.details(id));
  if (what == "job") return json_said(studio_.said(id, int(number_in(request, "id"))));
  if (what == "upload")
    return json_said(
        json_of(studio_.uploads(id)->state(word_in(request, "name"), number_in(request, "of"))));
  if (what == "thumb") return thumbnail_answer(studio_.project(id), request);
  if (what == "mask") return mask_answer(studio_.project(id), request);
  if (what.starts_with("file/"))
    return file_answer(studio_.project(id).folder, what.substr(std::string_view("file/").size()));
  if (what.starts_with("live/")) {
    std::string rest = what.substr(std::string_view("live/").size());
    int job = 0;
    const std::string digits = take_part(rest);
    std::from_chars(digits.data(), digits.data() + digits.size(), job);
    const int port = port_in(studio_.live_view(id, job));
    return port ? forwarded(port, request, "/" + rest)
                : http_error(404, "this run does not show itself now");
  }
  return http_error(404, "there is nothing at this address");
}

HttpAnswer StudioServer::post_to_project(const HttpRequest& request, const std::string& id,
                                         const std::string& what) {
  if (what == "upload")
    return json_said(
        json_of(studio_.uploads(id)->take(word_in(request, "name"), number_in(request, "at"),
                                          number_in(request, "of"), request.body)));
  if (what == "mask") {
    studio_.paint(id, word_in(request, "name"), turn_in(request), request.body);
    return json_said(Json::object());
  }
  const auto job = [&] { return int(number_in(request, "id")); };
  if (what == "run") return json_said({{"id", studio_.start(id, words_of(body_of(request)))}});
  if (what == "go_on") return json_said({{"id", studio_.go_on(id, job())}});
  if (what == "remove") return json_said({{"folder", studio_.remove(id).string()}});
  if (what == "stop") return studio_.stop(id, job()), json_said(Json::object());
  if (what == "ask") return json_said(studio_.ask(id, words_of(body_of(request))));
  if (what == "view") {
    const std::filesystem::path folder = studio_.project(id).folder;
    return json_said(
        {{"port", viewers_.open(folder, words_of(body_of(request)), word_in(request, "time"))}});
  }
  if (what == "live") {
    const std::string url = studio_.live_view(id, job());
    return json_said({{"hash", url.substr(std::min(url.find('#'), url.size()))}});
  }
  if (what == "keep")
    return json_said({{"file", studio_.keep(id, word_in(request, "name"), body_of(request))}});
  if (what != "change") return http_error(404, "there is nothing at this address");
  const Json changes = body_of(request);
  take_from_json("the request", "load the page again", [&] { studio_.change(id, changes); });
  return json_said(Json::object());
}

}  // namespace gs
