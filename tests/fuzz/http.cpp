// SPDX-License-Identifier: Apache-2.0
// Requests to the viewer's server: the head, the names of hosts, the query of /frame. The same bytes
// are text on its way to a terminal.
#include "gs_app/view/frame_request.h"
#include "gs_app/view/http/http_parse.h"
#include "gs_core/system/text/foreign_text.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

/// A head that arrives in two pieces is as long as one that arrives at once.
std::size_t length_of(std::string_view bytes) {
  const std::size_t length = head_length(bytes, 0), half = bytes.size() / 2;
  if (head_length(bytes.substr(0, half), 0) == 0)
    require(head_length(bytes, half) == length, "a head in two pieces has another length");
  return length;
}

void answer(const HttpHead& head) {
  const std::string host = head.value("host");
  require(!is_own_host(host, "127.0.0.1") || is_loopback(host),
          "a server of this machine answers to another name");
  takes([&] {
    const FrameRequest frame = frame_request_of(head.request);
    require(frame.camera.width >= 1 && frame.camera.width <= kLargestFrameSide &&
                frame.camera.height >= 1 && frame.camera.height <= kLargestFrameSide &&
                frame.camera.fx > 0 && is_finite(frame.camera.position()),
            "a frame has an impossible camera");
  });
}

void show(std::string_view text) {
  const std::string shown = fit_for_terminal(text, kLongestMessage), word = shown_word(text);
  require(shown.size() <= kLongestMessage, "a message is too long");
  require(shown == fit_for_terminal(shown, kLongestMessage), "a message changes when shown again");
  require(word.size() <= kLongestWord && word.find('\n') == word.npos, "a word is no word");
}

void read(std::string_view bytes) {
  if (const auto head = parse_head(bytes.substr(0, length_of(bytes)))) answer(*head);
  show(bytes);
}

const Registered registered{"http", read};

}  // namespace
}  // namespace gs::fuzz
