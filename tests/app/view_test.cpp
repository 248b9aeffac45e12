// SPDX-License-Identifier: Apache-2.0
// What the viewer's server answers and what it refuses, in this process. view_verbs_test.cpp tests
// the verbs that start it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include <chrono>
#include <thread>

#include "data_loaders/georef/georef_file.h"
#include "data_loaders/photos/photos.h"
#include "gs_app/view/file_view.h"
#include "gs_core/error.h"
#include "gs_core/system/host_name.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/http_client.h"
#include "tests/support/program.h"
#include "tests/support/random_model.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

/// A FileView behind a server of its own.
class Served {
 public:
  explicit Served(std::unique_ptr<FileView> view)
      : view_(std::move(view)), server_({"127.0.0.1", 0}, [this](const HttpRequest& request) {
          return view_answer(*view_, request);
        }) {}
  std::optional<HttpGot> get(const std::string& path, const HttpHeaders& headers = {}) const {
    return ask(server_.port(), "GET " + path, headers);
  }
  std::optional<HttpGot> post(const std::string& path) const {
    return ask(server_.port(), "POST " + path);
  }
  /// Sends these bytes and returns what the server answers until it ends the connection.
  std::string say(const std::string& bytes) const {
    const RawConnection connection(server_.port());
    connection.say(bytes);
    return connection.answer();
  }
  SortedJson json(const std::string& path) const { return SortedJson::parse(get(path)->body); }

 private:
  std::unique_ptr<FileView> view_;
  HttpServer server_;
};

class View : public Program {
 protected:
  /// The model or run in `name` as `gemsplat view` serves it.
  Served serve(const std::string& name, const DatasetConfig* dataset = nullptr) {
    const OpenedModel opened = open_model(path(name), std::nullopt);
    Config config = opened.config;
    if (dataset) config.dataset = *dataset;
    return Served(std::make_unique<FileView>(view_scene_of(opened, config, dataset, ""),
                                             serve_model(opened)));
  }
  Image8 decoded(const std::string& bytes) {
    write_bytes(path("picture.jpg"), bytes);
    return read_photo(path("picture.jpg"));
  }
  fs::path ply() const { return path("out/point_cloud/iteration_20/point_cloud.ply"); }
};

double mean_difference(const Image8& a, const Image8& b) {
  EXPECT_EQ(a.pixels.size(), b.pixels.size());
  double sum = 0;
  for (std::size_t i = 0; i < std::min(a.pixels.size(), b.pixels.size()); ++i)
    sum += std::abs(int(a.pixels[i]) - int(b.pixels[i]));
  return sum / double(a.pixels.size());
}

TEST(HttpHosts, OnlyNamesOfTheLoopbackAreOwnThere) {
  for (const char* named : {"127.0.0.1:7070", "localhost", "LocalHost:80", "[::1]:7070", "::1"})
    EXPECT_TRUE(is_own_host(named, "127.0.0.1")) << named;
  for (const char* named : {"evil.example", "127.0.0.1.evil.example", "192.168.0.7:7070", "",
                            "localhost.evil.example", "[fe80::1]", "[[::1]:7070"})
    EXPECT_FALSE(is_own_host(named, "127.0.0.1")) << named;
}

TEST(HttpHosts, OpenServersAnswerToAddressesAndGivenNamesAlone) {
  EXPECT_TRUE(is_own_host("192.168.0.7:7070", "0.0.0.0"));
  EXPECT_TRUE(is_own_host("box.example:7070", "box.example"));
  EXPECT_FALSE(is_own_host("evil.example", "0.0.0.0"));
  EXPECT_FALSE(is_own_host("evil.example", "box.example"));
}

TEST(HttpHosts, ANameThatOnlyBeginsWithTheMachinesIsForeign) {
  const std::string machine = host_name();
  ASSERT_FALSE(machine.empty());
  EXPECT_TRUE(is_own_host(machine + ":7070", "0.0.0.0"));
  EXPECT_FALSE(is_own_host(machine + ".evil.example:7070", "0.0.0.0"));
  EXPECT_FALSE(is_own_host(machine + ".evil.example", machine));
}

TEST(Http, APortThatIsTakenIsNamed) {
  const HttpServer first({"127.0.0.1", 0}, [](const HttpRequest&) { return HttpAnswer(); });
  try {
    const HttpServer second({"127.0.0.1", first.port()},
                            [](const HttpRequest&) { return HttpAnswer(); });
    FAIL() << "two servers share a port";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr(std::to_string(first.port())), HasSubstr("--port")));
  }
}

TEST(Http, WhatAHandlerThrowsIsAnAnswer) {
  const HttpServer server(
      {"127.0.0.1", 0}, [](const HttpRequest&) -> HttpAnswer { throw Error("no such\x1bthing"); });
  const auto answer = ask(server.port(), "GET /");
  EXPECT_EQ(answer->status, 500);
  EXPECT_THAT(answer->body, Not(HasSubstr("thing")));  // the terminal learns it
}

TEST_F(View, OfARunHasItsCamerasWithSplitsAndPhotos) {
  ASSERT_EQ(train("out").code, 0);
  const Served served = serve("out");
  const SortedJson scene = served.json("/scene.json");
  EXPECT_EQ(scene.at("mode"), "file");
  EXPECT_EQ(scene.at("title"), "out") << "where it lies is nobody's business";
  EXPECT_THAT(scene.at("notes"), IsEmpty());
  ASSERT_EQ(scene.at("cameras").size(), std::size_t(kViews));
  const SortedJson& camera = scene.at("cameras").at(1);  // the second test view
  EXPECT_EQ(camera.at("name"), "view_3.png");
  EXPECT_EQ(camera.at("split"), "test");
  EXPECT_EQ(scene.at("cameras").at(2).at("split"), "train");
  EXPECT_EQ(camera.at("width"), kWidth);
  EXPECT_EQ(camera.at("fy"), 40);
  EXPECT_EQ(camera.at("cx"), 20);
  const std::vector<double> expected{1, 0, 0, 0.3, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  for (int i = 0; i < 16; ++i)
    EXPECT_NEAR(camera.at("world_from_camera").at(i), expected[i], 1e-6) << i;
  EXPECT_EQ(scene.at("up"), SortedJson({0, -1, 0}));
  EXPECT_GT(scene.at("radius"), 0.0);
  const SortedJson state = served.json("/state.json");
  EXPECT_EQ(state.at("done"), true);
  EXPECT_EQ(state.at("gaussians"), scene.at("model").at("gaussians"));
  EXPECT_THAT(state.at("losses"), IsEmpty());
  EXPECT_EQ(served.get("/state.json?after=1x")->status, 400);

  const auto photo = served.get("/" + camera.at("photo").get<std::string>());
  EXPECT_EQ(photo->header("Content-Type"), "image/jpeg");
  EXPECT_LT(mean_difference(decoded(photo->body), read_photo(path("scene/images/view_3.png"))), 4);
}

TEST_F(View, TheModelHasTheBytesOfItsFile) {
  ASSERT_EQ(train("out").code, 0);
  const Served served = serve("out");
  const auto model = served.get("/model?v=1");
  EXPECT_EQ(model->status, 200);
  EXPECT_EQ(model->body, read_bytes(ply()));
  const SortedJson said = served.json("/scene.json").at("model");
  EXPECT_EQ(said.at("format"), "ply");
  EXPECT_EQ(said.at("bytes"), model->body.size());
  EXPECT_EQ(said.at("name"), "point_cloud.ply");
  EXPECT_EQ(said.at("sh_degree"), 3);
  EXPECT_EQ(said.at("gaussians"), read_gaussian_ply(ply()).gaussians.count());
}

// What a build without zlib says of a model that it would compress; nothing with zlib.
std::string why_not_compressed(const fs::path& probe) {
  try {
    write_model(probe, random_model(1, 1));
    return {};
  } catch (const Error& missing) {
    return missing.what();
  }
}

TEST_F(View, LevelsOfDetailAreStreamed) {
  if (const auto why = why_not_compressed(path("probe.rad")); !why.empty()) GTEST_SKIP() << why;
  const GaussianModel model = random_model(300, 1);
  write_model(path("model.rad"), model);
  const std::string bytes = read_bytes(path("model.rad"));
  const Served served = serve("model.rad");
  const SortedJson said = served.json("/scene.json").at("model");
  EXPECT_EQ(said.at("format"), "rad");
  EXPECT_EQ(said.at("gaussians"), 300);
  const auto part = served.get("/model?v=0", {{"Range", "bytes=8-107"}});
  EXPECT_EQ(part->status, 206);
  EXPECT_EQ(part->body, bytes.substr(8, 100));
  EXPECT_EQ(part->header("Content-Range"), fmt::format("bytes 8-107/{}", bytes.size()));
}

TEST_F(View, ThePageHasTheBytesOfItsFileAndIsNeverKept) {
  if (!can_view()) GTEST_SKIP() << cannot_view();
  ASSERT_EQ(train("out").code, 0);
  const auto page = serve("out").get("/", {{"Accept-Encoding", "gzip, br"}});
  EXPECT_EQ(page->body, read_bytes(GS_VIEW_PAGE));
  EXPECT_EQ(page->header("Cache-Control"), "no-store");
  EXPECT_THAT(page->header("Content-Type"), HasSubstr("text/html"));
}

TEST_F(View, OtherFormatsAreServedAsTheyAreOrAsAPly) {
  if (const auto why = why_not_compressed(path("probe.spz")); !why.empty()) GTEST_SKIP() << why;
  ASSERT_EQ(train("out").code, 0);
  ASSERT_EQ(run("export " + text("out") + " " + text("a.spz") + " " + text("b.glb") + " " +
                text("c.compressed.ply"))
                .code,
            0);
  const Served spz = serve("a.spz");
  EXPECT_EQ(spz.get("/model")->body, read_bytes(path("a.spz")));
  const SortedJson model = spz.json("/scene.json").at("model");
  EXPECT_EQ(model.at("format"), "spz");
  EXPECT_EQ(model.at("world_from_file"),
            SortedJson({1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1}));
  EXPECT_EQ(serve("c.compressed.ply").get("/model")->body, read_bytes(path("c.compressed.ply")));

  const Served glb = serve("b.glb");
  EXPECT_EQ(glb.json("/scene.json").at("model").at("format"), "ply");
  EXPECT_EQ(glb.json("/scene.json").at("model").at("name"), "b.glb");
  write_bytes(path("d.ply"), glb.get("/model")->body);
  EXPECT_EQ(read_gaussian_ply(path("d.ply")).gaussians.count(),
            read_gaussian_ply(ply()).gaussians.count());
  EXPECT_THAT(glb.json("/scene.json").at("cameras"), IsEmpty());
}

TEST_F(View, AnAsciiPlyIsMadeBinary) {
  ASSERT_EQ(train("out").code, 0);
  std::string file = read_bytes(ply());
  const std::size_t body = file.find("end_header\n") + 11;
  std::istringstream header(file.substr(0, body));
  std::string text_file;
  std::size_t columns = 0;
  for (std::string line; std::getline(header, line);) {
    columns += line.starts_with("property");
    text_file += (line.starts_with("format") ? "format ascii 1.0" : line) + "\n";
  }
  const auto* numbers = reinterpret_cast<const float*>(file.data() + body);
  for (std::size_t i = 0; i < (file.size() - body) / sizeof(float); ++i) {
    float value = 0;
    std::memcpy(&value, numbers + i, sizeof value);
    text_file += fmt::format("{}{}", value, (i + 1) % columns ? ' ' : '\n');
  }
  write_bytes(path("ascii.ply"), text_file);
  EXPECT_THAT(serve("ascii.ply").get("/model")->body, HasSubstr("format binary_little_endian"));
}

TEST_F(View, WithoutItsSceneARunHasNoPhotosAndSaysSo) {
  ASSERT_EQ(train("out").code, 0);
  fs::rename(path("scene"), path("elsewhere"));
  const SortedJson scene = serve("out").json("/scene.json");
  ASSERT_EQ(scene.at("cameras").size(), std::size_t(kViews));
  EXPECT_TRUE(scene.at("cameras").at(0).at("photo").is_null());
  EXPECT_EQ(scene.at("cameras").at(0).at("split"), "test");
  EXPECT_THAT(scene.at("notes").at(0),
              AllOf(HasSubstr("no photos: "), Not(HasSubstr(path("scene").string()))));

  DatasetConfig dataset;
  dataset.source = text("elsewhere");
  EXPECT_EQ(serve("out", &dataset).get("/photo/5")->status, 200);
}

TEST_F(View, AMissingPhotoFailsAloneAndInWords) {
  ASSERT_EQ(train("out").code, 0);
  const Served served = serve("out");
  fs::remove(path("scene/images/view_3.png"));
  const auto photo = served.get("/photo/1");
  EXPECT_EQ(photo->status, 500);
  EXPECT_THAT(photo->body, AllOf(HasSubstr("view_3.png"), Not(HasSubstr(path("scene").string()))));
  EXPECT_EQ(served.get("/photo/0")->status, 200);
}

TEST_F(View, WhatHasNoAddressIsNotFound) {
  ASSERT_EQ(train("out").code, 0);
  const Served served = serve("out");
  for (const char* address : {"/photo/6", "/photo/-1", "/photo/1x", "/photo/", "/etc/passwd",
                              "/../../../../etc/passwd", "/model/", "/index.html", "/frame?w=1"})
    EXPECT_EQ(served.get(address)->status, 404) << address;
  EXPECT_EQ(served.post("/model")->status, 404);
}

TEST_F(View, RequestsOfOtherNamesAndPagesAreRefused) {
  ASSERT_EQ(train("out").code, 0);
  const Served served = serve("out");
  for (const char* address : {"/", "/scene.json", "/model", "/photo/0"}) {
    EXPECT_EQ(served.get(address, {{"Host", "evil.example"}})->status, 403) << address;
    EXPECT_EQ(served.get(address, {{"Host", "localhost:1234"}})->status, 200) << address;
  }
  EXPECT_EQ(
      served.get("/photo/0", {{"Sec-Fetch-Site", "cross-site"}, {"Sec-Fetch-Mode", "no-cors"}})
          ->status,
      403);
  for (const auto& [destination, status] : {std::pair{"document", 200}, {"iframe", 403}})
    EXPECT_EQ(served
                  .get("/", {{"Sec-Fetch-Site", "cross-site"},
                             {"Sec-Fetch-Mode", "navigate"},
                             {"Sec-Fetch-Dest", destination}})
                  ->status,
              status)
        << destination;
}

TEST_F(View, TheBodyOfARefusedRequestIsNoRequest) {
  ASSERT_EQ(train("out").code, 0);
  const Served served = serve("out");
  const std::string hidden = "GET /scene.json HTTP/1.1\r\nHost: localhost\r\n\r\n";
  const std::string answers = served.say(
      fmt::format("POST /x HTTP/1.1\r\nHost: evil.example\r\nContent-Length: {}\r\n\r\n{}",
                  hidden.size(), hidden));
  EXPECT_THAT(answers, StartsWith("HTTP/1.1 403"));
  EXPECT_EQ(answers.find("HTTP/1.1", 1), answers.npos) << answers;
}

// --- Large models, lengths, looks

TEST_F(View, AFileWithoutCamerasSaysWhichWayIsUp) {
  const double tilt = 20 * M_PI / 180;
  GaussianModel floor = random_model(2000, 0);
  for (std::size_t i = 0; i < 2000; ++i) {
    const Vec3f p = floor.gaussians.mean[i];
    floor.gaussians.mean[i] = {float(std::cos(tilt)) * p.x, float(std::sin(tilt)) * p.x, p.z};
    floor.gaussians.log_scale[i] = Vec3f(-3);
    floor.gaussians.logit_opacity[i] = 2;
  }
  write_model(path("floor.ply"), floor);
  const Served served = serve("floor.ply");
  const SortedJson scene = served.json("/scene.json");
  EXPECT_NEAR(scene.at("up").at(0), std::sin(tilt), 0.02);
  EXPECT_NEAR(scene.at("up").at(1), -std::cos(tilt), 0.02);
  EXPECT_FALSE(scene.contains("eye")) << "nothing hides its middle";
  EXPECT_FALSE(scene.contains("up_is_known"));
}

TEST_F(View, ALargeModelIsMadeALevelledOneWhichIsSentInRanges) {
  if (const auto why = why_not_compressed(path("probe.rad")); !why.empty()) GTEST_SKIP() << why;
  ASSERT_EQ(train("out").code, 0);
  const OpenedModel opened = open_model(path("out"), std::nullopt);
  const std::size_t count = opened.model.gaussians.count();
  EXPECT_EQ(serve_model(opened).format->name, "ply") << "small";
  EXPECT_EQ(serve_model(opened, count + 1).format->name, "ply");
  EXPECT_EQ(serve_model(opened, 0).format->name, "ply") << "not wanted";
  const ServedModel large = serve_model(opened, count);
  EXPECT_EQ(large.format->name, "rad");
  EXPECT_EQ(large.name, "point_cloud.ply") << "its own name is shown";
  EXPECT_EQ(read_model(large.file).gaussians.count(), count);
  const Served served(
      std::make_unique<FileView>(view_scene_of(opened, opened.config, false, ""), large));
  EXPECT_EQ(served.json("/scene.json").at("model").at("format"), "rad");
  const auto part = served.get("/model", {{"Range", "bytes=0-63"}});
  EXPECT_EQ(part->status, 206);
  EXPECT_EQ(part->body, read_bytes(large.file).substr(0, 64));
}

TEST_F(View, LengthsHaveMetersWhereTheSceneStandsOnEarth) {
  ASSERT_EQ(train("out").code, 0);
  EXPECT_FALSE(serve("out").json("/scene.json").contains("meters_per_unit"));
  GeorefFile file;
  file.georeference = {{11.5, 48.1, 520}, {2.5, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, Vec3d(0.0)}};
  file.source = "a test";
  write_georef(georef_file_of(path("scene")), file);
  EXPECT_DOUBLE_EQ(serve("out").json("/scene.json").at("meters_per_unit"), 2.5);
  ASSERT_EQ(run("edit " + text("out") + " --scale 2 -o " + text("twice.ply")).code, 0);
  DatasetConfig dataset;
  dataset.source = text("scene");
  EXPECT_NEAR(serve("twice.ply", &dataset).json("/scene.json").at("meters_per_unit").get<double>(),
              1.25, 1e-6)
      << "two units of the larger model are one of the scene";
  write_bytes(georef_file_of(path("scene")), "{}");
  const SortedJson scene = serve("out").json("/scene.json");
  EXPECT_FALSE(scene.contains("meters_per_unit"));
  EXPECT_THAT(scene.at("notes").dump(), HasSubstr("no meters"));
}

TEST_F(View, CamerasHaveTheLookOfTheirPhotos) {
  ASSERT_EQ(train("gains", "--set photometric.model=gains --set photometric.rate=0.1").code, 0);
  const SortedJson scene = serve("gains").json("/scene.json");
  const SortedJson numbers = SortedJson::parse(read_bytes(path("gains/photometric.json")));
  for (const SortedJson& camera : scene.at("cameras")) {
    const std::string name = camera.at("name");
    const SortedJson& photo =
        numbers.at("photos").contains(name) ? numbers["photos"][name] : numbers["held_out"][name];
    EXPECT_NEAR(camera.at("look").at("gain").at(0).get<double>(),
                std::exp(photo.at("log_gain_red").get<double>()), 1e-5)
        << name;
  }
  ASSERT_EQ(train("plain").code, 0);
  EXPECT_FALSE(serve("plain").json("/scene.json").at("cameras").at(0).contains("look"));
  write_bytes(path("gains/photometric.json"), "[");
  EXPECT_THAT(serve("gains").json("/scene.json").at("notes").dump(), HasSubstr("neutral"));
}

// --- Frames

class Remote : public View {
 protected:
  Served serve_remote() {
    opened_ = open_model(path("out"), std::nullopt);
    const ViewScene scene = view_scene_of(opened_, opened_.config, false, "");
    auto renderer = std::make_unique<FrameRenderer>(
        "cpu", opened_.model, view_settings(opened_, opened_.config), look_of(scene));
    return Served(
        std::make_unique<FileView>(scene, opened_.model.gaussians.count(), std::move(renderer)));
  }
  OpenedModel opened_;
};

// Of camera 0, view_0.
const std::string kFrame =
    "/frame?w=40&h=32&fx=40&fy=40&cx=20&cy=16&m=1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1&q=100";

TEST_F(Remote, AFrameIsThePictureThatRenderMakes) {
  ASSERT_EQ(train("out").code, 0);
  ASSERT_EQ(run("render " + text("out") + " -o " + text("pictures") + " --device cpu").code, 0);
  const Served served = serve_remote();
  const SortedJson scene = served.json("/scene.json");
  EXPECT_EQ(scene.at("mode"), "remote");
  EXPECT_EQ(scene.at("cameras").at(0).at("name"), "view_0.png");
  const auto frame = served.get(kFrame);
  ASSERT_EQ(frame->status, 200) << frame->body;
  EXPECT_GT(std::stod(frame->header("X-Render-Ms")), 0);
  // A JPEG of quality 100 differs by about one level, and by more where color is averaged over 2 x
  // 2 pixels.
  EXPECT_LT(mean_difference(decoded(frame->body), read_photo(path("pictures/view_0.png"))), 3);
  EXPECT_EQ(served.get("/model")->status, 404);
}

TEST_F(Remote, AFrameCanHaveTheColorsOfAPhoto) {
  ASSERT_EQ(train("out", "--set photometric.model=gains").code, 0);
  SortedJson numbers = SortedJson::parse(read_bytes(path("out/photometric.json")));
  numbers["held_out"]["view_0.png"]["log_gain_red"] = -1;  // a look that nobody can miss
  write_bytes(path("out/photometric.json"), numbers.dump());
  ASSERT_EQ(run("render " + text("out") + " -o " + text("like") + " --like each --device cpu").code,
            0);
  const Served served = serve_remote();
  const Image8 wanted = read_photo(path("like/view_0.png"));
  const auto frame = [&](const std::string& more) { return served.get(kFrame + more); };
  const double as_photo = mean_difference(decoded(frame("&look=0")->body), wanted);
  EXPECT_LT(as_photo, 3);
  EXPECT_GT(mean_difference(decoded(frame("")->body), wanted), as_photo + 3) << "neutral";
  for (const char* bad : {"&look=6", "&look=-1", "&look=x", "&look=1e300"})
    EXPECT_EQ(frame(bad)->status, 400) << bad;
}

TEST_F(Remote, AFrameIsSeenThroughTheLensOfACamera) {
  ASSERT_EQ(train("out").code, 0);
  opened_ = open_model(path("out"), std::nullopt);
  ViewScene scene = view_scene_of(opened_, opened_.config, false, "");
  Camera& camera = scene.cameras.at(0).camera;
  camera.lens = endless_lens<float>(Lens::fisheye);
  const RenderSettings settings = view_settings(opened_, opened_.config);
  RenderPass pass;
  make_scalar_renderer()->forward(opened_.model.gaussians.span(), camera, settings, pass);
  const Image8 wanted = to_image8(image_of(pass));
  const Served served(
      std::make_unique<FileView>(scene, opened_.model.gaussians.count(),
                                 std::make_unique<FrameRenderer>("cpu", opened_.model, settings)));
  EXPECT_EQ(served.json("/scene.json").at("cameras").at(0).at("has_lens"), true);
  EXPECT_FALSE(served.json("/scene.json").at("cameras").at(1).contains("has_lens"));
  const auto frame = [&](const std::string& more) { return served.get(kFrame + more); };
  const double through = mean_difference(decoded(frame("&lens=0")->body), wanted);
  EXPECT_LT(through, 3);
  EXPECT_GT(mean_difference(decoded(frame("&lens=1")->body), wanted), through + 3) << "a pinhole";
  for (const char* bad : {"&lens=6", "&lens=x", "&lens=0&mode=normal"})
    EXPECT_EQ(frame(bad)->status, 400) << bad;
}

TEST_F(Remote, DepthAndNormalsAreOfTheFramesSize) {
  ASSERT_EQ(train("out").code, 0);
  const Served served = serve_remote();
  for (const char* mode : {"depth", "normal"}) {
    const auto frame = served.get(kFrame + "&mode=" + mode);
    ASSERT_EQ(frame->status, 200) << frame->body;
    const Image8 picture = decoded(frame->body);
    EXPECT_EQ(picture.width, kWidth);
    EXPECT_GT(*std::max_element(picture.pixels.begin(), picture.pixels.end()), 50) << mode;
  }
}

TEST_F(Remote, WordsThatCannotBeTakenAreNamed) {
  ASSERT_EQ(train("out").code, 0);
  const Served served = serve_remote();
  const auto refusal = [&](const std::string& word, const std::string& instead) {
    std::string address = kFrame;
    const std::size_t at = address.find(word);
    const auto answer = served.get(address.replace(at, word.size(), instead));
    EXPECT_EQ(answer->status, 400) << instead;
    return answer->body;
  };
  EXPECT_THAT(refusal("w=40", "w=0"), HasSubstr("cannot use w: 0"));
  EXPECT_THAT(refusal("h=32", "h=4097"), HasSubstr("4096"));
  EXPECT_THAT(refusal("h=32", "h=3.5"), HasSubstr("whole number"));
  EXPECT_THAT(refusal("fx=40", "fx=nan"), HasSubstr("cannot use fx"));
  EXPECT_THAT(refusal("fy=40", "fy=-1"), HasSubstr("focal length"));
  EXPECT_THAT(refusal("&cx=20", ""), HasSubstr("cannot use cx: it is missing"));
  EXPECT_THAT(refusal("q=100", "q=101"), HasSubstr("cannot use q"));
  EXPECT_THAT(refusal("q=100", "mode=xray"), HasSubstr("color, depth and normal"));
  EXPECT_THAT(refusal("m=1,0", "m=2,0"), HasSubstr("not a rotation"));
  EXPECT_THAT(refusal("m=1,0", "m=-1,0"), HasSubstr("not a rotation"));  // mirrored
  EXPECT_THAT(refusal("m=1,0", "m=0"), HasSubstr("16 numbers"));
}

TEST_F(Remote, ANewerRequestOfTheSameClientOvertakesOneThatWaits) {
  ASSERT_EQ(train("out").code, 0);
  const Served served = serve_remote();
  std::string large = kFrame;
  large.replace(large.find("w=40&h=32"), 9, "w=4000&h=3000");  // keeps the renderer busy
  std::map<int, int> statuses;
  std::mutex mutex;
  std::vector<std::thread> askers;
  const auto ask = [&](const std::string& address) {
    askers.emplace_back([&, address] {
      const int status = served.get(address)->status;
      const std::lock_guard lock(mutex);
      ++statuses[status];
    });
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  };
  ask(large + "&client=a");
  for (int i = 0; i < 3; ++i) ask(kFrame + "&client=b");
  ask(kFrame + "&client=c");
  for (std::thread& asker : askers) asker.join();
  EXPECT_EQ(statuses[200], 3);  // a, the last of b, c
  EXPECT_EQ(statuses[409], 2);
}

}  // namespace
}  // namespace gs
