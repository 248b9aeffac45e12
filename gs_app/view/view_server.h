// SPDX-License-Identifier: Apache-2.0
// The viewer's answers to HTTP requests: the page and its data. docs/reference/viewer_http.md lists
// the addresses. Start reading here.
#pragma once

#include <string>

#include "gs_app/view/http/http_server.h"
#include "gs_app/view/view_scene.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// A model and its cameras, as the viewer shows them: a finished one (FileView) or a run
/// (LiveView). Every function except the destructor is called from several threads at a time.
class ViewSource {
 public:
  virtual ~ViewSource() = default;
  /// Does not change while it is served.
  virtual const ViewScene& scene() const = 0;
  /// "mode" and "model" of /scene.json; without "model" as long as there is none.
  virtual Json mode_and_model() = 0;
  /// /state.json, with the losses that were logged after a step. A page that polls it counts as
  /// watching.
  virtual Json state(int after_step) = 0;
  virtual HttpAnswer model() = 0;
  virtual HttpAnswer frame(const HttpRequest& request);
  /// POST /control.
  virtual HttpAnswer control(const HttpRequest& request);
};

/// The state of a model that is not being trained: {"step": 0, ..., "version": 1, "done": true}.
Json finished_state(std::size_t gaussians);

/// The answer to a request for /, /scene.json, /state.json, /model, /mesh, /photo/I or /frame, or to POST
/// /control; 404 for any other.
HttpAnswer view_answer(ViewSource& source, const HttpRequest& request);

/// Whether this build has the viewer's page. If not, cannot_view() says what is missing.
bool can_view();
std::string cannot_view();

/// Throws Error if this build cannot serve the viewer.
void check_can_view();

/// Warns if other machines can reach the server.
void warn_if_public(const HttpPlace& place, int port);

}  // namespace gs
