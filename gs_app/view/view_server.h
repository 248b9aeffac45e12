// SPDX-License-Identifier: Apache-2.0
// The viewer over HTTP: the page, and what it asks for. docs/viewer.md lists the addresses.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "gs_app/view/http_server.h"
#include "gs_app/view/view_scene.h"

namespace gs {

/// What is looked at. Every function but the destructor is called from several threads at a time.
class ViewSource {
 public:
  virtual ~ViewSource() = default;
  /// Const for as long as it is served.
  virtual const ViewScene& scene() const = 0;
  /// "mode" and "model" of /scene.json; no "model" where there is none yet.
  virtual nlohmann::ordered_json mode_and_model() = 0;
  /// /state.json. Somebody who asks watches.
  virtual nlohmann::ordered_json state() = 0;
  virtual HttpAnswer model() = 0;
  virtual HttpAnswer frame(const HttpRequest& request);
};

/// State of a model that nobody trains: {"step": 0, ..., "version": 1, "done": true}.
nlohmann::ordered_json finished_state(std::size_t gaussians);

/// The answer to a request: the page, scene.json, state.json, model, photo/I, frame; 404 for all else.
HttpAnswer view_answer(ViewSource& source, const HttpRequest& request);

/// Whether this build can serve viewers: it has the page and an HTTP server. Where not, cannot_view() says what is missing.
bool can_view();
std::string cannot_view();

/// Throws Error where it cannot.
void check_can_view();

/// Warns where others than this machine may come.
void warn_of_guests(const HttpPlace& place);

}  // namespace gs
