// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/http/http_parse.h"

#include <algorithm>
#include <charconv>

#include "gs_core/system/text/ascii.h"

namespace gs {
namespace {

constexpr std::string_view kLineEnd = "\r\n", kHeadEnd = "\r\n\r\n";
constexpr std::string_view kMarksInNames = "!#$%&'*+-.^_`|~";  // RFC 9110, "token"

bool is_letter_or_digit(char c) {
  return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

bool is_name(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) {
    return is_letter_or_digit(c) || kMarksInNames.find(c) != kMarksInNames.npos;
  });
}

bool is_control(char c) { return (static_cast<unsigned char>(c) < 0x20 && c != '\t') || c == 0x7f; }

// The part before `mark`; the rest stays in `text`, without the mark.
std::string_view take_until(std::string_view& text, std::string_view mark) {
  const std::size_t at = text.find(mark);
  const std::string_view part = text.substr(0, at);
  text = at == text.npos ? std::string_view() : text.substr(at + mark.size());
  return part;
}

// "a%20b" -> "a b". A % without two digits stays as it is; in a query + is a space.
std::string decoded(std::string_view text, bool is_query) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    unsigned value = 0;
    const char* const digits = text.data() + i + 1;
    if (text[i] == '%' && i + 2 < text.size() &&
        std::from_chars(digits, digits + 2, value, 16).ptr == digits + 2) {
      result += char(value);
      i += 2;
    } else {
      result += is_query && text[i] == '+' ? ' ' : text[i];
    }
  }
  return result;
}

void parse_address(std::string_view address, HttpRequest& request) {
  request.path = decoded(take_until(address, "?"), false);
  while (!address.empty()) {
    std::string_view word = take_until(address, "&");
    const std::string name = decoded(take_until(word, "="), true);
    request.query.insert_or_assign(name, decoded(word, true));
  }
}

// "GET /photo/1 HTTP/1.1"
bool parse_first_line(std::string_view line, HttpHead& head) {
  head.method = take_until(line, " ");
  const std::string_view address = take_until(line, " ");
  if (!is_name(head.method) || !address.starts_with('/')) return false;
  parse_address(address, head.request);
  return line == "HTTP/1.1" || line == "HTTP/1.0";
}

bool parse_header(std::string_view line, HttpHead& head) {
  const std::size_t colon = line.find(':');
  if (colon == line.npos || !is_name(line.substr(0, colon))) return false;
  head.headers.emplace_back(lowercase(std::string(line.substr(0, colon))),
                            trimmed(line.substr(colon + 1)));
  return true;
}

}  // namespace

std::size_t HttpHead::count(std::string_view name) const {
  return std::size_t(std::count_if(headers.begin(), headers.end(),
                                   [&](const auto& header) { return header.first == name; }));
}

std::string HttpHead::value(std::string_view name) const {
  for (const auto& [header, value] : headers)
    if (header == name) return value;
  return {};
}

std::size_t head_length(std::string_view bytes, std::size_t known) {
  const std::size_t begin = known < kHeadEnd.size() ? 0 : known - kHeadEnd.size() + 1;
  const std::size_t at = bytes.find(kHeadEnd, begin);
  return at == bytes.npos ? 0 : at + kHeadEnd.size();
}

std::optional<HttpHead> parse_head(std::string_view text) {
  HttpHead head;
  for (bool is_first = true; !text.empty(); is_first = false) {
    const std::string_view line = take_until(text, kLineEnd);
    if (line.empty()) break;  // the end of the head
    if (std::any_of(line.begin(), line.end(), is_control)) return std::nullopt;
    if (!(is_first ? parse_first_line(line, head) : parse_header(line, head))) return std::nullopt;
  }
  if (head.method.empty()) return std::nullopt;
  head.request.method = head.method;
  if (head.count("x-control-token") == 1) head.request.token = head.value("x-control-token");
  if (head.count("range") == 1) head.request.range = head.value("range");
  return head;
}

}  // namespace gs
