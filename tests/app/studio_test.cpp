// SPDX-License-Identifier: Apache-2.0
// The studio: project.json, uploads of strangers, what its server answers to whom, and jobs of a
// studio that was killed. apps/web/tests/studio_test.mjs drives its page in a browser.
#include "gs_app/studio/studio.h"

#include <gmock/gmock.h>
#include <sys/resource.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "gs_app/studio/studio_server.h"
#include "gs_core/error.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/processes/signals.h"
#include "gs_model/formats/coding/zip_file.h"
#include "tests/support/error_of.h"
#include "tests/support/http_client.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const std::string kSecret = "0123456789abcdef0123456789abcdef";

Project example_project(const fs::path& folder) {
  Project project{.folder = folder, .name = "fox"};
  project.left_out = {"a.jpg"};
  project.jobs.push_back({.id = 3,
                          .words = {"train", "scene", "-o", "run-3"},
                          .state = JobState::running,
                          .began = 7});
  return project;
}

// Waits until no job of the project waits or runs; a minute at most.
Json settled(Studio& studio) {
  for (int i = 0; i < 600; ++i) {
    Json jobs = studio.state()["projects"][0]["jobs"];
    const auto is_active = [](const Json& job) {
      return job["state"] == "running" || job["state"] == "waiting";
    };
    if (std::none_of(jobs.begin(), jobs.end(), is_active)) return jobs;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return "the jobs did not end";
}

// ---- projects

TEST(StudioProject, IsReadAsItWasWritten) {
  const TempFolder folder;
  write_project(example_project(folder.path()));
  const Project project = read_project(folder.path());
  EXPECT_EQ(project.name, "fox");
  EXPECT_THAT(project.left_out, ElementsAre("a.jpg"));
  ASSERT_EQ(project.jobs.size(), 1u);
  EXPECT_EQ(project.jobs[0].id, 3);
  EXPECT_EQ(project.jobs[0].state, JobState::running);
  EXPECT_THAT(project.jobs[0].words, ElementsAre("train", "scene", "-o", "run-3"));
  EXPECT_EQ(project.jobs[0].began, 7);
}

TEST(StudioProject, DamageIsAnErrorThatNamesTheFile) {
  const TempFolder folder;
  for (const char* text : {"", "{", "[]", "{\"version\": 1}", "{\"version\": 2}"}) {
    write_bytes(folder.path() / "project.json", text);
    EXPECT_THAT(error_of([&] { read_project(folder.path()); }), HasSubstr("project.json")) << text;
  }
}

TEST(StudioProject, NamesOfStrangersLeadNowhereElse) {
  EXPECT_EQ(safe_path("day 1/a.JPG"), "day 1/a.JPG");
  EXPECT_EQ(safe_path("Füchse.jpg"), "Füchse.jpg");
  const std::string deep = "1/2/3/4/5/6/7/8/9";
  for (const std::string& name :
       {std::string(""), std::string("../a"), std::string("a/../b"), std::string("/etc/passwd"),
        std::string("a//b"), std::string("a/"), std::string(".hidden"), std::string("a/.git/b"),
        std::string("a\\b"), std::string("a\nb"), std::string("a\0b", 3), std::string("\xff.jpg"),
        std::string(201, 'a'), deep})
    EXPECT_THROW(safe_path(name), UsageError) << name;
}

TEST(StudioProject, AnotherTryUsesTheResumeOfTheVerb) {
  const auto go_on = [](std::vector<std::string> words) {
    return words_to_go_on({.id = 1, .words = std::move(words)});
  };
  EXPECT_THAT(go_on({"train", "s", "-o", "r"}), ElementsAre("train", "s", "-o", "r", "--resume"));
  EXPECT_THAT(go_on({"train", "--resume", "r"}), ElementsAre("train", "--resume", "r"));
  EXPECT_THAT(go_on({"reconstruct", "p", "-o", "s"}), ElementsAre("reconstruct", "p", "-o", "s"));
  EXPECT_THAT(go_on({"edit", "r", "-o", "e"}), ElementsAre("edit", "r", "-o", "e", "--force"));
}

// ---- uploads

TEST(StudioUploads, GoOnWhereTheyWereInterrupted) {
  const TempFolder folder;
  {
    Uploads uploads(folder.path());
    EXPECT_EQ(uploads.take("a/b.jpg", 0, 6, "abc").bytes, 3u);
  }
  Uploads again(folder.path());
  EXPECT_EQ(again.state("a/b.jpg", 6).bytes, 3u);
  EXPECT_EQ(again.take("a/b.jpg", 0, 6, "abc").bytes, 3u);  // passed over: it is there
  EXPECT_FALSE(fs::exists(folder.path() / "input/a/b.jpg"));
  EXPECT_TRUE(again.take("a/b.jpg", 3, 6, "def").is_whole);
  EXPECT_EQ(read_bytes(folder.path() / "input/a/b.jpg"), "abcdef");
  EXPECT_TRUE(again.state("a/b.jpg", 6).is_whole);
  EXPECT_THAT(error_of([&] { again.take("a/b.jpg", 0, 7, "1234567"); }),
              HasSubstr("another content"));
  EXPECT_EQ(read_bytes(folder.path() / "input/a/b.jpg"), "abcdef");
}

TEST(StudioUploads, HaveLimitsThatLoseNothing) {
  const TempFolder folder;
  Uploads uploads(folder.path(), {.bytes = 100, .free_bytes = 0, .files = 3});
  uploads.take("1", 0, 4, "1234");
  EXPECT_THROW(uploads.take("2", 0, 2, "123"), UsageError);  // longer than was said
  EXPECT_THAT(error_of([&] { uploads.take("2", 0, 200, "12"); }), HasSubstr("at most"));
  uploads.take("2", 0, 1, "1");
  uploads.take("3", 0, 1, "1");
  EXPECT_THAT(error_of([&] { uploads.take("4", 0, 1, "1"); }), HasSubstr("3 files at most"));
  EXPECT_EQ(read_bytes(folder.path() / "input/1"), "1234");
  Uploads full(folder.path(), {.bytes = 100, .free_bytes = std::uint64_t(1) << 60, .files = 10});
  EXPECT_THAT(error_of([&] { full.take("4", 0, 1, "1"); }), HasSubstr("the disk is full"));
}

TEST(StudioUploads, KeepWhatHasArrivedWhereTheDiskIsFull) {
  ignore_file_size_signal();
  const TempFolder folder;
  Uploads uploads(folder.path());
  uploads.take("a", 0, 300'000, std::string(100'000, 'a'));
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{150'000, before.rlim_max};  // bytes of the largest file
  setrlimit(RLIMIT_FSIZE, &small);
  const std::string error =
      error_of([&] { uploads.take("a", 100'000, 300'000, std::string(100'000, 'b')); });
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_THAT(error, HasSubstr("what has arrived stays"));
  const std::uint64_t there = uploads.state("a", 300'000).bytes;
  EXPECT_GE(there, 100'000u);
  EXPECT_TRUE(uploads.take("a", there, 300'000, std::string(300'000 - there, 'b')).is_whole);
}

TEST(StudioUploads, UnpackArchivesWithoutLeavingTheirFolder) {
  const TempFolder folder;
  Uploads uploads(folder.path());
  const auto drop = [&](const std::string& name, const std::string& zip) {
    return uploads.take(name, 0, zip.size(), zip);
  };
  const std::string fox = zip_of({{"fox/images/a.jpg", "aaa"},
                                  {"fox/sparse/0/cameras.txt", "c"},
                                  {"fox/images/", ""},
                                  {"__MACOSX/fox/images/._a.jpg", "x"},
                                  {"fox/images/.DS_Store", "x"}},
                                 true);
  EXPECT_TRUE(drop("fox.zip", fox).is_whole);
  EXPECT_EQ(read_bytes(folder.path() / "input/images/a.jpg"), "aaa");
  EXPECT_EQ(read_bytes(folder.path() / "input/sparse/0/cameras.txt"), "c");
  EXPECT_FALSE(fs::exists(folder.path() / "input/fox.zip"));
  EXPECT_TRUE(drop("two.zip", zip_of({{"a/1.jpg", "1"}, {"b/2.jpg", "2"}})).is_whole);
  EXPECT_EQ(read_bytes(folder.path() / "input/a/1.jpg"), "1");
  EXPECT_FALSE(fs::exists(folder.path() / "input/images/.DS_Store"));
  EXPECT_THROW(drop("evil.zip", zip_of({{"../../evil", "x"}})), UsageError);
  EXPECT_FALSE(fs::exists(folder.path().parent_path() / "evil"));
  EXPECT_THROW(drop("bad.zip", "PK no zip"), Error);
  EXPECT_EQ(uploads.state("bad.zip", 9).bytes, 0u);  // a better one can come
}

TEST(StudioUploads, CountTheFilesOfAnArchive) {
  const TempFolder folder;
  Uploads uploads(folder.path(), {.bytes = 1 << 20, .free_bytes = 0, .files = 4});
  std::vector<ZipEntry> many;
  for (int i = 0; i < 50; ++i) many.push_back({"p" + std::to_string(i), "x"});
  const std::string zip = zip_of(many);
  EXPECT_THAT(error_of([&] { uploads.take("many.zip", 0, zip.size(), zip); }),
              HasSubstr("4 files at most"));
}

// ---- the server

class StudioPages : public ::testing::Test {
 protected:
  std::string at(const std::string& path) const { return "/" + kSecret + "/" + path; }
  HttpGot got(const std::string& request, const HttpHeaders& headers = {}) const {
    return ask(server_.port(), request, headers).value_or(HttpGot{});
  }
  HttpGot post(const std::string& path, const std::string& body, HttpHeaders headers = {}) const {
    headers.emplace_back("Host", "localhost");
    std::string text = "POST " + path + " HTTP/1.1\r\n";
    headers.emplace_back("Content-Length", std::to_string(body.size()));
    for (const auto& [name, value] : headers) text += name + ": " + value + "\r\n";
    const RawConnection connection(server_.port());
    connection.say(text + "\r\n" + body);
    const std::string answer = connection.answer();
    const std::size_t end = std::min(answer.find("\r\n\r\n"), answer.size());
    return {end == answer.size() ? 0 : std::stoi(answer.substr(answer.find(' ') + 1)),
            answer.substr(0, end), answer.substr(std::min(end + 4, answer.size()))};
  }

  TempFolder folder_;
  Studio studio_{folder_.path()};
  StudioServer pages_{studio_, kSecret};
  HttpServer server_{{"127.0.0.1", 0},
                     [this](const HttpRequest& request) { return pages_.answer(request); },
                     pages_.limits()};
};

TEST_F(StudioPages, AnswerOnlyThoseWhoKnowTheSecret) {
  EXPECT_EQ(got("GET " + at("state")).status, 200);
  const std::string other = "/1123456789abcdef0123456789abcdef/";
  for (const std::string& path : {std::string("/"), std::string("/state"), other, other + "state",
                                  "/" + kSecret, "/" + kSecret.substr(1) + "/"})
    EXPECT_EQ(got("GET " + path).status, 403) << path;
  EXPECT_EQ(post(other + "new?name=a", "").status, 403);
  EXPECT_EQ(post(other + "new?name=a", "body").status, 400);  // which is not read
  EXPECT_THAT(studio_.state()["projects"], IsEmpty());
}

TEST_F(StudioPages, AnswerNoOtherPageAndNoOtherName) {
  EXPECT_EQ(got("GET " + at("state"), {{"Host", "evil.example"}}).status, 403);
  EXPECT_EQ(got("GET " + at("state"), {{"Sec-Fetch-Site", "cross-site"}}).status, 403);
  for (const HttpHeaders& foreign :
       {HttpHeaders{{"Origin", "http://evil.example"}}, HttpHeaders{{"Origin", "null"}},
        HttpHeaders{{"Sec-Fetch-Site", "same-site"}}, HttpHeaders{{"Sec-Fetch-Site", "none"}}})
    EXPECT_EQ(post(at("new?name=a"), "", foreign).status, 403);
  EXPECT_THAT(studio_.state()["projects"], IsEmpty());
}

TEST_F(StudioPages, ReadNoBodyWithoutEnd) {
  EXPECT_EQ(post(at("new?name=a"), "", {{"Transfer-Encoding", "chunked"}}).status, 400);
  const RawConnection endless(server_.port());
  endless.say("POST " + at("p/a/upload?name=a&at=0&of=9") +
              " HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999999\r\n\r\nabc");
  EXPECT_THAT(endless.answer(), HasSubstr("413"));
}

TEST_F(StudioPages, TakeAnUploadAndSayWhatIsWrongInALine) {
  ASSERT_EQ(post(at("new?name=fox"), "").status, 200);
  EXPECT_THAT(post(at("p/fox/upload?name=a.jpg&at=0&of=3"), "abc").body, HasSubstr("true"));
  EXPECT_EQ(read_bytes(folder_.path() / "fox/input/a.jpg"), "abc");
  const HttpGot evil = post(at("p/fox/upload?name=..%2F..%2Fevil&at=0&of=3"), "abc");
  EXPECT_EQ(evil.status, 400);
  EXPECT_THAT(evil.body, HasSubstr("rename it"));
  EXPECT_EQ(post(at("p/none/upload?name=a&at=0&of=3"), "abc").status, 400);
  EXPECT_EQ(post(at("p/fox/run"), R"({"words": ["self-doc"]})").status, 400);
  EXPECT_EQ(post(at("p/fox/run"), R"({"words": [1]})").status, 400);
  EXPECT_EQ(post(at("p/fox/run"), "{").status, 400);
}

TEST_F(StudioPages, GiveFilesOfTheProjectAlone) {
  studio_.create("fox", "");
  write_bytes(folder_.path() / "fox/share/1/a.html", "<p>");
  write_bytes(folder_.path() / "secret", "no");
  fs::create_symlink(folder_.path() / "secret", folder_.path() / "fox/share/link");
  const HttpGot page = got("GET " + at("p/fox/file/share/1/a.html"));
  EXPECT_EQ(page.body, "<p>");
  EXPECT_THAT(page.header("Content-Security-Policy"), HasSubstr("sandbox"));
  for (const char* path :
       {"p/fox/file/../secret", "p/fox/file/%2e%2e/secret", "p/fox/file/share/link",
        "p/fox/file//etc/passwd", "p/%2e%2e/file/secret", "p/fox/thumb?name=../a"})
    EXPECT_EQ(got("GET " + at(path)).status, 400) << path;
}

// ---- jobs

class StudioJobs : public ::testing::Test {
 protected:
  StudioJobs() { set_program_to_start(GS_PROGRAM); }
  TempFolder folder_;
};

TEST_F(StudioJobs, RunInTheirProjectOneAfterTheOther) {
  Studio studio(folder_.path());
  const std::string id = studio.create("fox", "");
  studio.start(id, {"doctor", "input"});
  studio.start(id, {"edit", "nothing.ply", "--recenter", "-o", "edits/{id}.ply"});
  const Json jobs = settled(studio);
  ASSERT_EQ(jobs.size(), 2u);
  EXPECT_EQ(jobs[0]["state"], "failed");  // there is no photo
  EXPECT_EQ(jobs[1]["words"][4], "edits/2.ply");
  EXPECT_THAT(std::string(jobs[1]["message"]), HasSubstr("nothing.ply"));
  EXPECT_THROW(studio.start(id, {"selftest"}), UsageError);
  EXPECT_EQ(studio.ask(id, {"config"})["train"]["seed"]["value"], 42);
}

TEST_F(StudioJobs, OfAStudioThatWasKilledAreInterruptedOrDone) {
  Project project{.folder = folder_.path() / "fox", .name = "fox"};
  const auto job = [](int id, JobState state) {
    return StudioJob{.id = id, .words = {"doctor", "input"}, .state = state};
  };
  project.jobs = {job(1, JobState::done), job(2, JobState::running)};
  write_project(project);
  write_bytes(project.log_of(2),
              "{\"event\":\"progress\",\"done\":1,\"total\":2}\n{\"event\":\"pro");
  {
    Studio studio(folder_.path());
    EXPECT_EQ(settled(studio)[1]["state"], "interrupted");
    studio.go_on("fox", 2);
    EXPECT_EQ(settled(studio)[1]["state"], "failed");  // it ran again, and there is no photo
  }
  project.jobs[1].state = JobState::running;
  write_project(project);
  write_bytes(project.log_of(2),
              "{\"event\":\"progress\",\"done\":2,\"total\":2}\n{\n  \"a\": 1\n}\n");
  Studio studio(folder_.path());
  EXPECT_EQ(settled(studio)[1]["state"], "done");
  EXPECT_EQ(studio.said("fox", 2)["outcome"]["a"], 1);
}

TEST_F(StudioJobs, ThatAnotherProcessHoldsAreStillRunning) {
  Project project{.folder = folder_.path() / "fox", .name = "fox"};
  project.jobs = {{.id = 1, .words = {"train", "s"}, .state = JobState::running}};
  write_project(project);
  Studio studio(folder_.path());
  {
    const Descriptor held = new_job_log(project.log_of(1));
    project.jobs[0].state = JobState::running;
    EXPECT_TRUE(is_job_alive(project.log_of(1)));
  }
  EXPECT_FALSE(is_job_alive(project.log_of(1)));
  EXPECT_THAT(error_of([&] { Studio second(folder_.path()); }), HasSubstr("another studio"));
}

}  // namespace
}  // namespace gs
