// SPDX-License-Identifier: Apache-2.0
// The viewer's HTTP server against connections that are slow, silent, endless or malformed. No
// test depends on how fast the machine is: what must end is given a minute, what must not end in time
// has no limit of time.
#include <gmock/gmock.h>
#include <netdb.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <deque>
#include <filesystem>
#include <future>
#include <optional>
#include <thread>

#include "gs_app/view/http/http_parse.h"
#include "gs_app/view/http/http_server.h"
#include "gs_core/error.h"
#include "tests/support/raw_connection.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr double kForever = 1e9;                      // seconds
constexpr std::size_t kLarge = std::size_t(1) << 24;  // more than sockets hold

/// Answers "/small" with a word, and "/large" with 16 MiB.
HttpAnswer answer(const HttpRequest& request) {
  static const auto large = std::make_shared<const std::string>(kLarge, 'x');
  if (request.path == "/small") return http_text("small", "text/plain");
  if (request.path != "/large") return http_error(404, request.path);
  HttpAnswer answer;
  answer.body = large;
  return answer;
}

/// No limit of time, and few connections.
HttpLimits patient(int connections = 8) {
  HttpLimits limits;
  limits.connections = connections;
  limits.head_seconds = limits.piece_seconds = kForever;
  return limits;
}

std::string asked(const HttpServer& server, const std::string& request) {
  const RawConnection connection(server.port());
  connection.say(request);
  return connection.answer();
}

std::string small_answer(const HttpServer& server) { return asked(server, get_request("/small")); }

int open_files() {
  return int(std::distance(fs::directory_iterator("/proc/self/fd"), fs::directory_iterator()));
}

// ---- requests

TEST(HttpServer, AnswersGetAndHead) {
  const HttpServer server({"127.0.0.1", 0}, answer);
  EXPECT_THAT(small_answer(server), StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(small_answer(server), EndsWith("Connection: close\r\n\r\nsmall"));
  const std::string head = asked(server, "HEAD /small HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(head, HasSubstr("Content-Length: 5\r\n"));
  EXPECT_THAT(head, EndsWith("\r\n\r\n"));
}

TEST(HttpServer, SendsTheRangeThatIsAskedFor) {
  const TempFolder folder;
  write_bytes(folder.path() / "digits", "0123456789");
  const HttpServer server({"127.0.0.1", 0}, [&](const HttpRequest& request) {
    if (request.path == "/text") return http_text("0123456789", "text/plain");
    if (request.path != "/file") return http_error(404, "nothing is here");
    HttpAnswer answer;
    answer.file = folder.path() / "digits";
    return answer;
  });
  const auto range = [&](const std::string& path, const std::string& bytes) {
    return asked(server,
                 "GET " + path + " HTTP/1.1\r\nHost: localhost\r\nRange: " + bytes + "\r\n\r\n");
  };
  for (const char* path : {"/text", "/file"}) {
    EXPECT_THAT(
        range(path, "bytes=2-4"),
        AllOf(StartsWith("HTTP/1.1 206 Partial Content\r\n"), EndsWith("\r\n\r\n234"),
              HasSubstr("Content-Length: 3\r\n"), HasSubstr("Content-Range: bytes 2-4/10\r\n")));
    EXPECT_THAT(range(path, "bytes=7-"), EndsWith("\r\n\r\n789"));
    EXPECT_THAT(range(path, "bytes=8-65535"), AllOf(EndsWith("\r\n\r\n89"), HasSubstr("8-9/10")));
    EXPECT_THAT(range(path, "bytes=10-11"),
                AllOf(StartsWith("HTTP/1.1 416 "), HasSubstr("Content-Range: bytes */10\r\n"),
                      EndsWith("\r\n\r\n")));
    for (const char* other : {"bytes=-3", "bytes=1-2,4-5", "bytes=5-4", "lines=1-2", "bytes=a-"})
      EXPECT_THAT(range(path, other),
                  AllOf(StartsWith("HTTP/1.1 200 OK\r\n"), EndsWith("\r\n\r\n0123456789")))
          << other;
  }
  EXPECT_THAT(range("/none", "bytes=0-1"), StartsWith("HTTP/1.1 404 "));
}

TEST(HttpServer, TakesARequestByteByByteAndFromAPeerThatSaysNoMore) {
  const HttpServer server({"127.0.0.1", 0}, answer, patient());
  const RawConnection connection(server.port());
  for (const char byte : get_request("/small")) ASSERT_TRUE(connection.say({byte}));
  connection.say_no_more();
  EXPECT_THAT(connection.answer(), EndsWith("small"));
}

TEST(HttpServer, TakesAPostOfItsOwnPageOrOfAProgramWithoutABody) {
  const HttpServer server({"127.0.0.1", 0}, [](const HttpRequest& request) {
    return http_text(request.method + " " + request.token + " end", "text/plain");
  });
  const std::string own = server.url().substr(0, server.url().size() - 1);
  const auto post = [&](const std::string& headers) {
    return asked(server, "POST /control HTTP/1.1\r\nHost: 127.0.0.1:" +
                             std::to_string(server.port()) + "\r\n" + headers + "\r\n");
  };
  EXPECT_THAT(post("X-Control-Token: secret\r\n"), EndsWith("POST secret end"));
  EXPECT_THAT(post("Origin: " + own + "\r\nSec-Fetch-Site: same-origin\r\nContent-Length: 0\r\n"),
              EndsWith("end"));
  for (const char* foreign :
       {"Origin: http://evil.example\r\n", "Origin: null\r\n", "Origin: http://127.0.0.1:1\r\n",
        "Sec-Fetch-Site: cross-site\r\n", "Sec-Fetch-Site: same-site\r\n",
        "Sec-Fetch-Site: none\r\n", "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Dest: document\r\n"})
    EXPECT_THAT(post(foreign), StartsWith("HTTP/1.1 403 ")) << foreign;
  for (const char* body : {"Content-Length: 5\r\n", "Transfer-Encoding: chunked\r\n",
                           "Content-Length: 0\r\nContent-Length: 0\r\n"})
    EXPECT_THAT(post(body), StartsWith("HTTP/1.1 400 ")) << body;
}

TEST(HttpServer, AnswersOneRequestOnAConnection) {
  const HttpServer server({"127.0.0.1", 0}, answer, patient());
  const std::string answers = asked(server, get_request("/small") + get_request("/other"));
  EXPECT_THAT(answers, EndsWith("small"));
  EXPECT_THAT(answers, testing::Not(HasSubstr("other")));
}

TEST(HttpServer, SendsALargeAnswerWhole) {
  const HttpServer server({"127.0.0.1", 0}, answer, patient());
  const std::string got = asked(server, get_request("/large"));
  EXPECT_EQ(got.size() - got.find("\r\n\r\n") - 4, kLarge);
}

TEST(HttpServer, SendsFilesAndSaysWhichIsGone) {
  const TempFolder folder;
  const std::string bytes(300'000, 'f');
  write_bytes(folder.path() / "there", bytes);
  ASSERT_EQ(::mkfifo((folder.path() / "fifo").c_str(), 0600), 0);
  const HttpServer server({"127.0.0.1", 0}, [&](const HttpRequest& request) {
    HttpAnswer answer;
    answer.file = folder.path() / request.path.substr(1);
    return answer;
  });
  EXPECT_THAT(asked(server, get_request("/there")), EndsWith("\r\n\r\n" + bytes));
  for (const char* name : {"/gone", "/fifo"}) {
    EXPECT_THAT(asked(server, get_request(name)), StartsWith("HTTP/1.1 500 ")) << name;
    // The reason is for the terminal alone: it names a folder of this machine.
    EXPECT_THAT(asked(server, get_request(name)), Not(HasSubstr(folder.path().string()))) << name;
  }
}

TEST(HttpParse, TakesApartAddressesAndHeaders) {
  const auto head = parse_head(
      "GET /a%20b%2?x=1+2&y=%26&z HTTP/1.1\r\nHost: here \r\nX-Two:\t1\r\nx-two: 2\r\n\r\n");
  ASSERT_TRUE(head);
  EXPECT_EQ(head->method, "GET");
  EXPECT_EQ(head->request.path, "/a b%2");
  EXPECT_EQ(head->request.query.at("x"), "1 2");
  EXPECT_EQ(head->request.query.at("y"), "&");
  EXPECT_EQ(head->request.query.at("z"), "");
  EXPECT_EQ(head->value("host"), "here");
  EXPECT_EQ(head->value("x-two"), "1");
  EXPECT_EQ(head->count("x-two"), 2u);
  EXPECT_EQ(head->value("none"), "");
}

TEST(HttpParse, RefusesMalformedHeads) {
  const std::string nul(1, '\0');
  for (const std::string& head :
       {std::string("\r\n"), std::string("GET / HTTP/2\r\n\r\n"), std::string("GET /\r\n\r\n"),
        std::string("GET http://x/ HTTP/1.1\r\n\r\n"), std::string("GET  / HTTP/1.1\r\n\r\n"),
        std::string("G=T / HTTP/1.1\r\n\r\n"), std::string("GET / HTTP/1.1 \r\n\r\n"),
        std::string("GET / HTTP/1.1\r\nHost : x\r\n\r\n"),
        std::string("GET / HTTP/1.1\r\nHost: x\r\n folded\r\n\r\n"),
        std::string("GET / HTTP/1.1\r\nno colon\r\n\r\n"),
        std::string("GET / HTTP/1.1\r\n: x\r\n\r\n"),
        std::string("GET / HTTP/1.1\nHost: x\r\n\r\n"), "GET /" + nul + " HTTP/1.1\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: x" + nul + "\r\n\r\n"})
    EXPECT_FALSE(parse_head(head)) << head;
  const HttpServer server({"127.0.0.1", 0}, answer, patient());
  EXPECT_THAT(asked(server, "nonsense\r\n\r\n"), StartsWith("HTTP/1.1 400 "));
}

TEST(HttpParse, FindsTheEndOfAHeadThatComesInPieces) {
  const std::string head = "GET / HTTP/1.1\r\nHost: x\r\n\r\nbody";
  for (std::size_t known = 0; known + 4 < head.size(); ++known)
    EXPECT_EQ(head_length(head, known), head.size() - 4) << known;
  EXPECT_EQ(head_length(head.substr(0, head.size() - 5), 3), 0u);
}

// ---- limits

TEST(HttpLimits, AHeadWithoutAnEndIsRefused) {
  const HttpServer server({"127.0.0.1", 0}, answer, patient());
  const RawConnection connection(server.port());
  connection.say("GET /small HTTP/1.1\r\nX: " + std::string(HttpLimits().head_bytes, 'x'));
  EXPECT_THAT(connection.answer(), StartsWith("HTTP/1.1 431 "));
  // One that goes on is cut off. It could say gigabytes.
  const RawConnection endless(server.port());
  const std::string piece(1 << 16, 'x');
  std::size_t pieces = 0;
  while (pieces < (1 << 20) && endless.say(piece)) ++pieces;
  EXPECT_LT(pieces, std::size_t(1 << 20));
}

TEST(HttpLimits, TheTimeForAHeadIsATotal) {
  HttpLimits limits = patient();
  limits.head_seconds = 0.1;
  const HttpServer server({"127.0.0.1", 0}, answer, limits);
  const RawConnection connection(server.port());
  ASSERT_TRUE(connection.say("GET /small HTTP/1.1\r\nX: "));
  int drops = 0;
  while (drops < 6000 && connection.say("x")) {
    ++drops;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_LT(drops, 6000);
}

TEST(HttpLimits, AReaderThatTakesNothingIsCutOff) {
  HttpLimits limits = patient();
  limits.piece_seconds = 0.1;
  const HttpServer server({"127.0.0.1", 0}, answer, limits);
  const RawConnection connection(server.port());
  ASSERT_TRUE(connection.say(get_request("/large")));
  EXPECT_TRUE(connection.is_closed_in_time());
}

TEST(HttpLimits, SilentConnectionsMakeWayForAPage) {
  const HttpServer server({"127.0.0.1", 0}, answer, patient(8));
  std::deque<RawConnection> silent;
  for (int i = 0; i < 200; ++i) silent.emplace_back(server.port());
  EXPECT_THAT(small_answer(server), EndsWith("small"));
  for (const RawConnection& connection : silent) connection.say("GET / HTTP/1.1\r\n");
  EXPECT_THAT(small_answer(server), EndsWith("small"));
}

TEST(HttpLimits, SlowReadersMakeWayForAPage) {
  HttpLimits limits = patient(8);
  limits.piece_seconds = 0.6;  // they make way after a tenth of a second
  const HttpServer server({"127.0.0.1", 0}, answer, limits);
  std::deque<RawConnection> slow;
  for (int i = 0; i < 100; ++i) slow.emplace_back(server.port()).say(get_request("/large"));
  EXPECT_THAT(small_answer(server), EndsWith("small"));
}

TEST(HttpLimits, AReaderThatReadsKeepsItsConnectionBesideSilentOnes) {
  const HttpServer server({"127.0.0.1", 0}, answer, patient(8));
  const RawConnection reader(server.port());
  reader.say(get_request("/large"));
  ASSERT_EQ(reader.first_byte(), 'H');
  std::deque<RawConnection> silent;
  for (int i = 0; i < 200; ++i) silent.emplace_back(server.port());
  EXPECT_THAT(small_answer(server), EndsWith("small"));
  const std::string got = reader.answer();
  EXPECT_EQ(got.size() - got.find("\r\n\r\n") - 4, kLarge);
}

TEST(HttpLimits, ConnectionsNeverTakeMoreFilesThanTheirLimit) {
  const HttpServer server({"127.0.0.1", 0}, answer, patient(8));
  EXPECT_THAT(small_answer(server), EndsWith("small"));
  const int before = open_files();
  std::deque<RawConnection> silent;
  for (int i = 0; i < 100; ++i) silent.emplace_back(server.port());
  EXPECT_THAT(small_answer(server), EndsWith("small"));  // so all others were accepted, too
  EXPECT_LE(open_files() - before - 100, 8);
}

TEST(HttpLimits, AnAnswerThatIsComputedIsWaitedForByTheOthers) {
  std::promise<void> begun, computed;
  const std::shared_future<void> is_computed(computed.get_future());
  const HttpServer server(
      {"127.0.0.1", 0},
      [&](const HttpRequest& request) {
        if (request.path == "/late") begun.set_value(), is_computed.wait();
        return http_text("answered", "text/plain");
      },
      patient(1));
  const RawConnection late(server.port());
  late.say(get_request("/late"));
  begun.get_future().wait();
  const RawConnection other(server.port());
  other.say(get_request("/small"));
  computed.set_value();
  EXPECT_THAT(late.answer(), EndsWith("answered"));
  EXPECT_THAT(other.answer(), EndsWith("answered"));
}

TEST(HttpServer, ItsThreadsYieldToOthersOnlyWhereTheyAreToldTo) {
  const auto priority = [](const HttpRequest&) {
    return http_text(std::to_string(getpriority(PRIO_PROCESS, id_t(gettid()))), "text/plain");
  };
  const int own = getpriority(PRIO_PROCESS, id_t(gettid()));
  const HttpServer usual({"127.0.0.1", 0}, priority);
  EXPECT_THAT(small_answer(usual), EndsWith("\r\n\r\n" + std::to_string(own)));
  const HttpServer beside_training({"127.0.0.1", 0}, priority, {.yields_to_others = true});
  EXPECT_THAT(small_answer(beside_training), EndsWith("\r\n\r\n19"));
}

// ---- the end

TEST(HttpServer, EndsAtOnceWhateverItsConnectionsDo) {
  std::optional<HttpServer> server;
  server.emplace(HttpPlace{"127.0.0.1", 0}, answer, patient(16));
  std::deque<RawConnection> connections;
  for (int i = 0; i < 4; ++i) {
    connections.emplace_back(server->port());  // silent
    connections.emplace_back(server->port()).say("GET / HTTP/1.1\r\n");
    connections.emplace_back(server->port()).say(get_request("/large"));
  }
  EXPECT_THAT(small_answer(*server), EndsWith("small"));  // so all others were accepted, too
  server.reset();                                         // there is no limit of time
  for (const RawConnection& connection : connections) EXPECT_TRUE(connection.is_closed_in_time());
}

// Its url would lead to the other program, because browsers ask the first address first.
TEST(HttpServer, DoesNotTakeTheSecondAddressOfAHostWhoseFirstIsTaken) {
  std::optional<HttpServer> other;
  try {
    other.emplace(HttpPlace{"::1", 0}, answer);
  } catch (const Error&) {
    GTEST_SKIP() << "this machine has no IPv6";
  }
  addrinfo wanted{}, *found = nullptr;
  wanted.ai_socktype = SOCK_STREAM;
  ASSERT_EQ(getaddrinfo("localhost", "80", &wanted, &found), 0);
  const bool is_first = found->ai_family == AF_INET6;
  freeaddrinfo(found);
  if (!is_first) GTEST_SKIP() << "localhost is 127.0.0.1 first";
  EXPECT_THROW(HttpServer({"localhost", other->port()}, answer), Error);
}

TEST(HttpServer, RefusesAnEmptyHost) {
  try {
    const HttpServer server({"", 0}, answer);
    FAIL() << server.url();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("--host"));
  }
}

}  // namespace
}  // namespace gs
