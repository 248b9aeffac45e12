// SPDX-License-Identifier: Apache-2.0
// `gemsplat view` and `gemsplat train --viewer` as processes: addresses, signals, exit codes, and
// the model of a watched run.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>

#include <chrono>
#include <functional>
#include <thread>

#include "gs_app/view/view_server.h"
#include "gs_core/error.h"
#include "gs_core/system/host_name.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/http_client.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// `gemsplat VERB ... ` beside this process, until it has printed its address.
class Started {
 public:
  Started(const std::vector<std::string>& arguments, const fs::path& log) : log_(log) {
    process_ = start_child(arguments, {.output = open_log(log)});
    for (int i = 0; i < 600 && port_ == 0; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      const std::string said = read_bytes(log);
      const std::size_t at = said.find("http://127.0.0.1:");
      if (at != said.npos && said.find('\n', at) != said.npos)
        port_ = std::stoi(said.substr(at + 17));
    }
    EXPECT_GT(port_, 0) << read_bytes(log);
  }
  ~Started() {
    if (process_ > 0) end(SIGKILL);
  }
  std::optional<HttpGot> get(const std::string& path) const {
    return gs::ask(port_, "GET " + path);
  }
  int port() const { return port_; }
  int end(int signal) {
    kill(process_, signal);
    return wait();
  }
  int wait() {
    int status = 0;
    waitpid(process_, &status, 0);
    process_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string said() const { return read_bytes(log_); }

 private:
  fs::path log_;
  pid_t process_ = 0;
  int port_ = 0;
};

class Verbs : public Program {
 protected:
  fs::path ply() const { return path("out/point_cloud/iteration_20/point_cloud.ply"); }
  void SetUp() override {
    if (!can_view()) GTEST_SKIP() << cannot_view();
  }
};

TEST_F(Verbs, ViewServesUntilASignalAndThenReturns0) {
  ASSERT_EQ(train("out").code, 0);
  for (const int signal : {SIGINT, SIGTERM}) {
    Started view({GS_PROGRAM, "view", text("out"), "--no-open", "--port", "0"}, path("view.log"));
    EXPECT_EQ(view.get("/model")->body, read_bytes(ply()));
    EXPECT_EQ(view.end(signal), 0) << view.said();
    fs::remove(path("view.log"));
  }
}

TEST_F(Verbs, ViewFindsTheMeshOfARunOrTakesAnother) {
  ASSERT_EQ(train("out").code, 0);
  const auto first_get = [&](std::vector<std::string> more, const std::string& address) {
    std::vector<std::string> words{GS_PROGRAM, "view", text("out"), "--no-open", "--port", "0"};
    words.insert(words.end(), more.begin(), more.end());
    Started view(words, path("view.log"));
    const std::string body = view.get(address)->body;
    view.end(SIGTERM);
    fs::remove(path("view.log"));
    return body;
  };
  EXPECT_FALSE(Json::parse(first_get({}, "/scene.json")).contains("mesh"));
  EXPECT_THAT(first_get({}, "/mesh"), HasSubstr("`gemsplat mesh` makes it"));
  ASSERT_EQ(run("mesh " + text("out") + " --collision --voxel 0.2 -o " + text("solid.glb")).code,
            0);
  EXPECT_EQ(first_get({"--mesh", text("solid.glb")}, "/mesh"), read_bytes(path("solid.glb")));
  fs::rename(path("solid.glb"), path("out-mesh.glb"));
  EXPECT_EQ(Json::parse(first_get({}, "/scene.json"))["mesh"]["name"], "out-mesh.glb");
  EXPECT_EQ(first_get({}, "/mesh"), read_bytes(path("out-mesh.glb")));
  write_bytes(path("out/mesh.glb"), "damaged");  // it comes first, and does not stop the viewer
  EXPECT_FALSE(Json::parse(first_get({}, "/scene.json")).contains("mesh"));
  const Outcome damaged =
      run("view " + text("out") + " --no-open --mesh " + text("out/mesh.glb") + " -q");
  EXPECT_EQ(damaged.code, 3);
  EXPECT_THAT(damaged.err, HasSubstr("out/mesh.glb"));
  EXPECT_EQ(run("view " + text("out") + " --no-open --mesh " + text("a.obj")).code, 2);
}

TEST_F(Verbs, ViewForOthersNamesTheAddressesOfThisMachine) {
  const std::vector<std::string> addresses = own_addresses();
  if (addresses.empty()) GTEST_SKIP() << "this machine has no address but loopback";
  ASSERT_EQ(train("out").code, 0);
  const fs::path log = path("view.log");
  const pid_t view = start_child(
      {GS_PROGRAM, "view", text("out"), "--no-open", "--port", "0", "--host", "0.0.0.0"},
      {.output = open_log(log)});
  for (int i = 0; i < 600 && read_bytes(log).find("http://localhost:") == std::string::npos; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  kill(view, SIGTERM);
  waitpid(view, nullptr, 0);
  for (const std::string& address : addresses)
    EXPECT_THAT(read_bytes(log), HasSubstr("http://" + address + ":"));
}

TEST_F(Verbs, ViewOpensTheBrowserWhereItIsAskedTo) {
  ASSERT_EQ(train("out").code, 0);
  write_bytes(path("bin/xdg-open"), "#!/bin/sh\necho \"$1\" >" + text("opened.tmp") + "; mv " +
                                        text("opened.tmp") + " " + text("opened") + "\n");
  fs::permissions(path("bin/xdg-open"), fs::perms::owner_all);
  const std::string old = std::getenv("PATH");
  setenv("PATH", (text("bin") + ":" + old).c_str(), 1);
  Started view({GS_PROGRAM, "view", text("out"), "--open", "--port", "0"}, path("view.log"));
  setenv("PATH", old.c_str(), 1);
  for (int i = 0; i < 100 && !fs::exists(path("opened")); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_THAT(view.said(), HasSubstr(read_bytes(path("opened"))));
  EXPECT_THAT(read_bytes(path("opened")), HasSubstr("http://127.0.0.1:"));
}

TEST_F(Verbs, ViewRefusesWhatItCannotShow) {
  EXPECT_EQ(run("view " + text("nothing.ply") + " --no-open").code, 3);
  ASSERT_EQ(train("out").code, 0);
  EXPECT_EQ(run("view " + text("out") + " --port 70000").code, 2);
  EXPECT_EQ(run("view " + text("out") + " --photo-ram 1").code, 2) << "it would do nothing";
  EXPECT_EQ(run("view " + text("out") + " --no-open --host 192.0.2.1 --port 0").code, 3);
}

TEST_F(Verbs, AWatchedRunShowsItselfAndLearnsTheSame) {
  const Outcome plain = train("out", "--iterations 1000");
  ASSERT_EQ(plain.code, 0) << plain.err;
  const std::string watched = text("scene") + " -o " + text("watched") + kTrain;
  std::istringstream words("train " + watched +
                           " --iterations 1000 --viewer --viewer-port 0 --viewer-wait");
  std::vector<std::string> arguments{GS_PROGRAM};
  for (std::string word; words >> word;) arguments.push_back(word);
  Started train(arguments, path("train.log"));
  SortedJson state = SortedJson::object();
  int last_step = 0, version = 0;
  for (int i = 0; i < 2400 && !state.value("done", false); ++i) {
    const auto answer = train.get("/state.json");
    ASSERT_TRUE(answer) << train.said();
    state = SortedJson::parse(answer->body);
    EXPECT_GE(state.at("step"), last_step);
    EXPECT_GE(state.at("version"), version);
    last_step = state.at("step");
    version = state.at("version");
    std::this_thread::sleep_for(std::chrono::milliseconds(25));
  }
  EXPECT_EQ(state.at("step"), 1000);
  EXPECT_EQ(state.at("steps"), 1000);
  EXPECT_GT(state.at("loss"), 0.0);
  EXPECT_GT(state.at("psnr"), 1.0);
  EXPECT_EQ(state.at("losses").back().at(1), state.at("loss"));
  EXPECT_GE(version, 2) << "one while it trained, and the last";
  const SortedJson scene = SortedJson::parse(train.get("/scene.json")->body);
  EXPECT_EQ(scene.at("mode"), "live");
  EXPECT_EQ(scene.at("title"), "watched");
  EXPECT_EQ(scene.at("cameras").size(), std::size_t(kViews));
  EXPECT_EQ(train.get("/photo/0")->status, 200);
  write_bytes(path("last." + scene.at("model").at("format").get<std::string>()),
              train.get("/model")->body);
  const std::string ply = "point_cloud/iteration_1000/point_cloud.ply";
  EXPECT_EQ(read_model(path("last." + scene.at("model").at("format").get<std::string>()))
                .gaussians.count(),
            read_gaussian_ply(path("watched") / ply).gaussians.count());
  EXPECT_EQ(train.end(SIGINT), 0) << train.said();
  EXPECT_EQ(read_bytes(path("watched") / ply), read_bytes(path("out") / ply));
}

/// `gemsplat train` with a viewer, and the token that it has printed.
class ControlledTrain : public Started {
 public:
  using Started::Started;
  int ask(const std::string& what) {
    const std::string log = said(), mark = "#control=";
    const std::size_t at = log.find(mark);
    const std::string token = at == log.npos ? "" : log.substr(at + mark.size(), 32);
    const auto answer = gs::ask(port(), "POST /control?do=" + what, {{"X-Control-Token", token}});
    return answer ? answer->status : 0;
  }
  /// The state once `is_so`.
  SortedJson state_when(const std::function<bool(const SortedJson&)>& is_so) {
    for (int i = 0; i < 2400; ++i) {
      if (const auto answer = get("/state.json"))
        if (SortedJson state = SortedJson::parse(answer->body); is_so(state)) return state;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    ADD_FAILURE() << said();
    return {};
  }
};

TEST_F(Verbs, ARunThatWasPausedAndSavedWritesTheSameModel) {
  ASSERT_EQ(train("out", "--iterations 1000").code, 0);
  const std::string command = "exec " + std::string(GS_PROGRAM) + " train " + text("scene") +
                              " -o " + text("paused") + kTrain +
                              " --iterations 1000 --viewer --viewer-port 0";
  ControlledTrain train({"/bin/sh", "-c", command}, path("train.log"));
  ASSERT_EQ(train.ask("pause"), 200);
  const auto is_paused_at_a_step = [](const SortedJson& state) {
    return state.at("control").at("paused") == true && state.at("step") > 0 &&
           state.at("version") > 0;  // the model of this step is shown
  };
  const int step = train.state_when(is_paused_at_a_step).at("step");
  ASSERT_LT(step, 1000);
  ASSERT_EQ(train.ask("save"), 200);
  train.state_when(
      [&](const SortedJson& state) { return state.at("control").at("saved") == step; });
  EXPECT_EQ(SortedJson::parse(train.get("/state.json")->body).at("step"), step)
      << "it stands still";
  EXPECT_TRUE(fs::exists(
      path("paused/point_cloud/iteration_" + std::to_string(step) + "/point_cloud.ply")));
  ASSERT_EQ(train.ask("resume"), 200);
  EXPECT_EQ(train.wait(), 0) << train.said();
  const std::string ply = "point_cloud/iteration_1000/point_cloud.ply";
  EXPECT_EQ(read_bytes(path("paused") / ply), read_bytes(path("out") / ply));
}

TEST_F(Verbs, APausedRunIsStoppedByItsPageOrByASignalWithItsModelSaved) {
  ASSERT_EQ(train("out").code, 0);  // makes the scene
  for (const bool by_page : {true, false}) {
    const std::string name = by_page ? "page" : "signal";
    const std::string command = "exec " + std::string(GS_PROGRAM) + " train " + text("scene") +
                                " -o " + text(name) + kTrain +
                                " --iterations 30000 --viewer --viewer-port 0";
    ControlledTrain train({"/bin/sh", "-c", command}, path(name + ".log"));
    ASSERT_EQ(train.ask("pause"), 200);
    train.state_when([](const SortedJson& state) { return state.at("version") > 0; });
    const int code = by_page ? (train.ask("stop"), train.wait()) : train.end(SIGINT);
    EXPECT_EQ(code, int(ExitCode::interrupted)) << train.said();
    EXPECT_THAT(train.said(), HasSubstr("the model is in"));
    EXPECT_FALSE(fs::is_empty(path(name + "/checkpoints")));
    EXPECT_FALSE(fs::is_empty(path(name + "/point_cloud")));
  }
}

TEST_F(Verbs, AnUnwatchedRunEndsByItself) {
  const Outcome outcome = train("out", "--viewer --viewer-port 0");
  EXPECT_EQ(outcome.code, 0);
  EXPECT_THAT(outcome.err, HasSubstr("viewer: http://127.0.0.1:"));
  EXPECT_EQ(train("again", "--viewer-port 0").code, 2) << "--viewer-port needs --viewer";
}

TEST_F(Verbs, APortThatIsTakenLeavesNoRunBehind) {
  const HttpServer other({"127.0.0.1", 0}, [](const HttpRequest&) { return HttpAnswer(); });
  const Outcome outcome = train("out", "--viewer --viewer-port " + std::to_string(other.port()));
  EXPECT_EQ(outcome.code, 3);
  EXPECT_FALSE(fs::exists(path("out/config.toml")));
}

}  // namespace
}  // namespace gs
