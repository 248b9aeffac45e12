// SPDX-License-Identifier: Apache-2.0
// The studio: project.json, what its server answers to whom, and jobs of a studio that was killed.
// studio_photos_test.cpp has photos, and studio_uploads_test.cpp uploads.
// apps/web/tests/studio_test.mjs drives its page in a browser.
#include "gs_app/studio/studio.h"

#include <gmock/gmock.h>
#include <sys/resource.h>

#include <array>
#include <chrono>
#include <csignal>
#include <set>
#include <thread>

#include "gs_app/studio/studio_server.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/processes/signals.h"
#include "gs_core/system/text/read_json.h"
#include "tests/support/error_of.h"
#include "tests/support/http_client.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

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

TEST(StudioProject, AddedStepsAreCountedOnce) {
  const TempFolder folder;
  const std::vector<std::string> more = {"train", "--resume", "run-1", "--iterations", "+1000"};
  auto words = more;
  set_extra_steps(folder.path(), words);
  EXPECT_EQ(words, more);  // there is no such run, and train says so
  write_bytes(folder.path() / "run-1/config.toml", "[train]\nextra_steps = 500\n");
  set_extra_steps(folder.path(), words);
  EXPECT_THAT(words, ElementsAre("train", "--resume", "run-1", "--set", "train.extra_steps=1500"));
  for (const char* other : {"+many", "5000"}) {
    words = {"train", "--resume", "run-1", "--iterations", other};
    set_extra_steps(folder.path(), words);
    EXPECT_EQ(words.back(), other);
  }
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

TEST_F(StudioPages, GiveAStrangerNothingAtAnyAddress) {
  studio_.create("fox", "");
  write_bytes(folder_.path() / "fox/share/1/a.html", "fox");
  const std::string other = "/1123456789abcdef0123456789abcdef/";
  const HttpHeaders host = {{"Host", "evil.example"}}, origin = {{"Origin", "http://evil.example"}},
                    null = {{"Origin", "null"}};
  for (const char* path :
       {"", "state", "p/fox/", "p/fox/job?id=1", "p/fox/upload?name=a&of=1", "p/fox/thumb?name=a",
        "p/fox/mask?name=a", "p/fox/file/share/1/a.html", "p/fox/live/1/", "view/1/"}) {
    EXPECT_EQ(got(std::string("GET ") + "/" + path).status, 403) << path;
    EXPECT_EQ(got("GET " + other + path).status, 403) << path;
    for (const HttpHeaders& headers : {host, origin, null}) {
      const HttpGot answer = got("GET " + at(path), headers);
      EXPECT_EQ(answer.status, 403) << path;
      EXPECT_THAT(answer.body, Not(HasSubstr("fox"))) << path;
    }
  }
  for (const char* path :
       {"new?name=a", "p/fox/upload?name=a&at=0&of=0", "p/fox/run", "p/fox/stop?id=1",
        "p/fox/go_on?id=1", "p/fox/ask", "p/fox/view?time=1", "p/fox/live?id=1",
        "p/fox/keep?name=path", "p/fox/mask?name=a", "p/fox/change", "p/fox/remove"}) {
    EXPECT_EQ(post(std::string("/") + path, "").status, 403) << path;
    EXPECT_EQ(post(other + path, "").status, 403) << path;
    for (const HttpHeaders& headers : {origin, null})
      EXPECT_EQ(post(at(path), "", headers).status, 403) << path;
  }
  ASSERT_EQ(studio_.state()["projects"].size(), 1u);
  EXPECT_EQ(studio_.state()["projects"][0]["jobs"].size(), 0u);
  EXPECT_THAT(entries_of(folder_.path() / "fox/input"), IsEmpty());
}

TEST_F(StudioPages, RenameAndRemoveAProject) {
  studio_.create("fox", "");
  EXPECT_EQ(post(at("p/fox/change"), R"({"name": "red fox"})").status, 200);
  for (const char* name : {R"({"name": ""})", R"({"name": "../a"})", R"({"name": 7})"})
    EXPECT_EQ(post(at("p/fox/change"), name).status, 400) << name;
  EXPECT_EQ(studio_.state()["projects"][0]["name"], "red fox");
  EXPECT_EQ(read_project(folder_.path() / "fox").name, "red fox");
  write_bytes(folder_.path() / "fox/edits/2.ply", "work");

  const fs::path removed = folder_.path() / "removed/fox";
  EXPECT_THAT(post(at("p/fox/remove"), "").body, HasSubstr(removed.string()));
  EXPECT_THAT(studio_.state()["projects"], IsEmpty());
  EXPECT_EQ(read_bytes(removed / "edits/2.ply"), "work");
  EXPECT_EQ(post(at("p/fox/remove"), "").status, 400);
  EXPECT_EQ(post(at("p/fox/upload?name=a&at=0&of=1"), "a").status, 400);

  EXPECT_EQ(studio_.create("fox", ""), "fox");
  EXPECT_EQ(studio_.remove("fox"), folder_.path() / "removed/fox-2");
  EXPECT_EQ(read_bytes(removed / "edits/2.ply"), "work");
  fs::rename(removed, folder_.path() / "fox");
  EXPECT_EQ(studio_.state()["projects"][0]["name"], "red fox");
  EXPECT_EQ(studio_.create("removed", ""), "removed-2");
}

TEST_F(StudioPages, RemoveNoProjectInWhichSomethingRuns) {
  studio_.create("fox", "");
  const fs::path run = folder_.path() / "fox/run-1";
  {
    const OutputLock lock = OutputLock::of_folder(run);
    EXPECT_THAT(error_of([&] { studio_.remove("fox"); }), HasSubstr("writes to run-1"));
  }
  const std::shared_ptr<Uploads> uploads = studio_.uploads("fox");
  {
    const auto arriving = uploads->pause();
    EXPECT_THAT(error_of([&] { studio_.remove("fox"); }), HasSubstr("files arrive"));
  }
  EXPECT_TRUE(fs::exists(folder_.path() / "fox/project.json"));
  studio_.remove("fox");
  EXPECT_THROW(uploads->take("a", 0, 1, "a"), UsageError);
  EXPECT_FALSE(fs::exists(folder_.path() / "fox"));
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

TEST_F(StudioJobs, OfTwoProjectsRunAtTheSameTime) {
  Studio studio(folder_.path());
  const std::string scene = std::string(GS_SOURCE_DIR) + "/examples/courtyard";
  for (const std::string& name : {std::string("fox"), std::string("owl")}) {
    studio.create(name, scene);
    studio.start(name, {"train", scene, "-o", "run-{id}", "-c", "cpu_tiny", "-r", "48",
                        "--iterations", "300"});
    studio.start(name, {"doctor", scene, "--headers-only"});
  }
  EXPECT_THAT(error_of([&] { studio.remove("owl"); }), HasSubstr("stop it first"));
  std::array<std::set<int>, 2> steps;  // that each run showed while the other one ran, too
  for (int i = 0; i < 1200; ++i) {
    const Json projects = studio.state()["projects"];
    bool are_active = false, are_training = true;
    for (const Json& project : projects) {
      const Json &train = project["jobs"][0], &doctor = project["jobs"][1];
      EXPECT_TRUE(doctor["state"] == "waiting" || train["state"] != "running");
      are_active |= doctor["state"] == "waiting" || doctor["state"] == "running";
      are_training &= train["state"] == "running" && train["progress"].is_object() &&
                      train["progress"]["unit"] == "step";
    }
    if (!are_active) break;
    for (std::size_t k = 0; are_training && k < steps.size(); ++k)
      steps[k].insert(int(projects[k]["jobs"][0]["progress"]["done"]));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  for (const Json& project : studio.state()["projects"])
    for (const Json& job : project["jobs"]) EXPECT_EQ(job["state"], "done") << job["message"];
  EXPECT_GE(steps[0].size(), 2u);
  EXPECT_GE(steps[1].size(), 2u);
}

TEST_F(StudioJobs, AddStepsOnceAlsoWhereTheyAreRepeated) {
  Studio studio(folder_.path());
  const std::string scene = std::string(GS_SOURCE_DIR) + "/examples/courtyard";
  studio.create("fox", scene);
  studio.start("fox",
               {"train", scene, "-o", "run-1", "-c", "cpu_tiny", "-r", "32", "--iterations", "20"});
  settled(studio);
  studio.start("fox", {"train", "--resume", "run-1", "--iterations", "+10"});
  EXPECT_EQ(settled(studio)[1]["state"], "done");
  studio.go_on("fox", 2);  // as where the studio was killed before it knew that the job was done
  EXPECT_EQ(settled(studio)[1]["state"], "done");
  EXPECT_EQ(read_json(folder_.path() / "fox/run-1/results.json")["iterations"], 30);
  studio.start("fox", {"train", "--resume", "run-1", "--iterations", "+10"});
  EXPECT_EQ(settled(studio)[2]["state"], "done");
  EXPECT_EQ(read_json(folder_.path() / "fox/run-1/results.json")["iterations"], 40);
}

TEST_F(StudioJobs, ChangeNothingWhereTheDiskIsFull) {
  ignore_file_size_signal();
  Studio studio(folder_.path());
  studio.create("fox", "");
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit none{0, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &none);
  const std::string changed = error_of([&] {
    studio.change("fox", {{"name", "owl"}});
  }),
                    started = error_of([&] {
                      studio.start("fox", {"doctor", "input"});
                    });
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_THAT(changed, HasSubstr("project.json"));
  EXPECT_THAT(started, HasSubstr("project.json"));
  EXPECT_EQ(studio.state()["projects"][0]["name"], "fox");
  EXPECT_THAT(studio.state()["projects"][0]["jobs"], IsEmpty());
  EXPECT_EQ(read_project(folder_.path() / "fox").name, "fox");
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
