// SPDX-License-Identifier: Apache-2.0
// Pages of other gemsplat processes below the studio's own address: `gemsplat view` of a version, and
// the live view of a run. Browsers then see one server, and its secret keeps both.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <list>
#include <mutex>
#include <string>
#include <vector>

#include "gs_app/view/http/http_server.h"

namespace gs {

/// What the server at a port of this machine answers to the request, for `path` in place of its own.
/// 502 where it does not answer.
HttpAnswer forwarded(int port, const HttpRequest& request, const std::string& path);

/// The port in "http://127.0.0.1:40123/#control=..."; 0 if there is none.
int port_in(const std::string& url);

/// Children that show models. The oldest one makes room for a new one.
class Viewers {
 public:
  ~Viewers();
  /// The port at which `gemsplat view WORDS`, started in `folder`, serves; one that shows this model
  /// of this `time` already is taken. Throws Error with what the child says where it cannot.
  int open(const std::filesystem::path& folder, const std::vector<std::string>& words,
           const std::string& time);
  /// Whether one of them serves there.
  bool has(int port);

 private:
  struct Viewer {
    std::filesystem::path folder;
    std::vector<std::string> words;
    std::string time;  // of the model, as the page has it
    pid_t child;
    int port;
  };
  Viewer start(const std::filesystem::path& folder, const std::vector<std::string>& words,
               const std::string& time);

  std::mutex mutex_;
  std::list<Viewer> viewers_;  // the one that was asked for last comes first
};

}  // namespace gs
