// SPDX-License-Identifier: Apache-2.0
// The studio's answers to HTTP requests. Everything lies below the secret of the address that the
// program prints; docs/reference/studio_http.md lists the addresses.
#pragma once

#include <string>

#include "gs_app/studio/studio.h"
#include "gs_app/studio/viewers.h"
#include "gs_app/view/http/http_server.h"

namespace gs {

class StudioServer {
 public:
  StudioServer(Studio& studio, std::string secret) : studio_(studio), start_("/" + secret + "/") {}

  /// 403 for whoever does not know the secret, 400 with a line for the page where something cannot
  /// be done.
  HttpAnswer answer(const HttpRequest& request);
  /// With bodies only of those who know the secret.
  HttpLimits limits() const;

 private:
  bool knows_secret(const HttpRequest& request) const;
  HttpAnswer answer_below(const HttpRequest& request, const std::string& path);
  HttpAnswer of_project(const HttpRequest& request, const std::string& id, const std::string& what);
  HttpAnswer post_to_project(const HttpRequest& request, const std::string& id,
                             const std::string& what);

  Studio& studio_;
  const std::string start_;
  Viewers viewers_;
};

/// Whether this build has the studio's page.
bool has_studio_page();

}  // namespace gs
