// SPDX-License-Identifier: Apache-2.0
// gemsplat render as users run it: the results of each source, path and output.
#include <gmock/gmock.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <numeric>

#include "data_loaders/cameras/read_cameras.h"
#include "data_loaders/georef/georef_file.h"
#include "data_loaders/photos/exr.h"
#include "data_loaders/photos/panorama.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/video/film_writer.h"
#include "data_loaders/video/sharpest_frames.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

class Render : public Program {
 protected:
  void SetUp() override { ASSERT_EQ(train("run").code, 0); }
  Outcome render(const std::string& more) {
    return run("render " + text("run") + " --device cpu " + more);
  }
  void expect_done(const std::string& more) {
    const Outcome outcome = render(more);
    EXPECT_EQ(outcome.code, 0) << more << ": " << outcome.err;
  }
  void expect_refused(const std::string& more, const std::string& reason, int code = 2) {
    const Outcome outcome = render(more);
    EXPECT_EQ(outcome.code, code) << more;
    EXPECT_THAT(outcome.err, HasSubstr(reason)) << more;
  }
  /// Positions of the cameras in a file.
  std::vector<Vec3f> places(const std::string& file) const {
    std::vector<Vec3f> result;
    for (const NamedCamera& named : read_cameras(path(file), Vec3d(0.0)))
      result.push_back(named.camera.position());
    return result;
  }
};

double distance(const Vec3f& a, const Vec3f& b) { return std::sqrt(inner(a - b, a - b)); }

int largest_difference(const fs::path& a, const fs::path& b) {
  const Image8 x = read_photo(a), y = read_photo(b);
  EXPECT_EQ(x.pixels.size(), y.pixels.size());
  int most = 0;
  for (std::size_t i = 0; i < std::min(x.pixels.size(), y.pixels.size()); ++i)
    most = std::max(most, std::abs(int(x.pixels[i]) - int(y.pixels[i])));
  return most;
}

TEST_F(Render, NormalsCanTeachAnotherRun) {
  const auto taught = [&](const std::string& maps, const std::string& axes) {
    return train(maps + axes, "-q --set surface.prior_weight=0.1 --set dataset.normals=" +
                                  text(maps) + " --set dataset.normal_axes=" + axes);
  };
  expect_done("--split all --write normal -o " + text("world"));
  expect_done("--split all --write normal --normal-space camera -o " + text("camera"));
  for (const auto& [maps, axes] : {std::pair{"world", "world"}, {"camera", "rub"}}) {
    const Outcome outcome = taught(maps, axes);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_NE(
        read_bytes(path(std::string(maps) + axes + "/point_cloud/iteration_20/point_cloud.ply")),
        read_bytes(path("run/point_cloud/iteration_20/point_cloud.ply")));
  }
  const Outcome refused = taught("camera", "rdf");
  EXPECT_EQ(refused.code, 3);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("% with rub"), HasSubstr("dataset.normal_axes")));
}

TEST_F(Render, TheColmapModelOfTheSceneGivesThePicturesOfTheRun) {
  expect_done("-o " + text("a"));
  expect_done("--cameras " + text("scene/sparse/0") + " -o " + text("b"));
  for (const char* name : {"view_0.png", "view_5.png"})
    EXPECT_LE(largest_difference(path("a") / name, path("b") / name), 1);
}

TEST_F(Render, TheCamerasOfASceneAreTakenWithoutDecodingItsPhotos) {
  expect_done("--split test -o " + text("a"));
  damage_photos(path("scene/images"));
  ASSERT_EQ(run("eval " + text("run") + " --device cpu").code, 3) << "the photos can be decoded";
  expect_done("--data " + text("scene") + " --test-every 3 --split test -o " + text("b"));
  EXPECT_EQ(largest_difference(path("a/view_3.png"), path("b/view_3.png")), 0);
  expect_refused("--masks none --data " + text("scene") + " -o " + text("c"), "--masks");
}

TEST_F(Render, EachQuantityHasAFileOfItsOwn) {
  expect_done("--split test --write color,normal,depth,alpha -o " + text("all"));
  for (const char* file : {"view_0.png", "view_0.depth.png", "view_0.alpha.png",
                           "view_0.normal.png", "view_3.depth.png"}) {
    ASSERT_TRUE(fs::exists(path("all") / file)) << file;
    EXPECT_EQ(read_photo_size(path("all") / file).width, kWidth);
  }
  EXPECT_FALSE(fs::exists(path("all/film.json")));
  expect_done("--split test --write depth -o " + text("alone"));  // has the plain name
  EXPECT_EQ(largest_difference(path("alone/view_0.png"), path("all/view_0.depth.png")), 0);
  expect_refused("--write hue -o " + text("none"), "hue");
}

TEST_F(Render, ExrHoldsDepthInWorldUnitsAndNormalsOfLengthOne) {
  if (!can_write_exr()) GTEST_SKIP() << cannot_write_exr();
  expect_done("--split test --write depth,normal,alpha --format exr -o " + text("exr"));
  EXPECT_FALSE(fs::exists(path("exr/view_0.depth.png")));
  std::vector<std::string> channels;
  const ImageF depth = read_exr(path("exr/view_0.depth.exr"), &channels);
  EXPECT_EQ(channels, std::vector<std::string>{"Z"});
  const ImageF alpha = read_exr(path("exr/view_0.alpha.exr"));
  const ImageF normal = read_exr(path("exr/view_0.normal.exr"));
  ASSERT_EQ(depth.pixels.size(), std::size_t(kWidth * kHeight));
  int seen = 0;
  for (std::size_t i = 0; i < depth.pixels.size(); ++i) {
    const float* n = &normal.pixels[3 * i];
    EXPECT_EQ(depth.pixels[i] > 0, alpha.pixels[i] >= 1.0f / 255) << i;
    if (depth.pixels[i] == 0) continue;
    ++seen;
    EXPECT_GT(depth.pixels[i], 1) << i;  // the scene's points are 3 to 5 units away
    EXPECT_LT(depth.pixels[i], 8) << i;
    EXPECT_NEAR(n[0] * n[0] + n[1] * n[1] + n[2] * n[2], 1, 1e-4);
  }
  EXPECT_GT(seen, kWidth * kHeight / 2);
  expect_done("--split test --write depth --format png,exr -o " + text("both"));
  EXPECT_TRUE(fs::exists(path("both/view_0.png")) && fs::exists(path("both/view_0.exr")));
  expect_refused("--format exr -o " + text("a.mp4"), "8 bits");
}

TEST_F(Render, AnOrbitIsACircleThatItsCamerasFileRepeats) {
  expect_done("--path orbit --frames 6 --elevation 20 --radius 3 --center 0 0 4 --size 24x20 -o " +
              text("orbit"));
  const auto orbit = places("orbit/cameras.json");
  ASSERT_EQ(orbit.size(), 6u);
  for (const Vec3f& place : orbit) EXPECT_NEAR(distance(place, {0, 0, 4}), 3, 1e-4);
  EXPECT_NEAR(distance(orbit[0], orbit[1]), distance(orbit[5], orbit[0]), 1e-4);
  EXPECT_EQ(read_photo_size(path("orbit/00005.png")).width, 24);
  const auto film = json("orbit/film.json");
  EXPECT_EQ(film.at("frames"), 6);
  EXPECT_EQ(film.at("path").at("kind"), "orbit");
  EXPECT_EQ(film.at("path").at("elevation"), 20);
  EXPECT_NEAR(film.at("path").at("swing").get<double>(), 10, 1e-9);  // seen from one side
  EXPECT_EQ(film.at("pictures").at("color").at(0), "{name}.png");
  EXPECT_EQ(film.at("cameras"), "cameras.json");
  expect_done("--path orbit --turns 1 --frames 2 --size 24x20 -o " + text("whole"));
  EXPECT_EQ(json("whole/film.json").at("path").at("turns"), 1);
  expect_done("--cameras " + text("orbit/cameras.json") + " -o " + text("again"));
  for (const char* name : {"00000.png", "00003.png"})
    EXPECT_LE(largest_difference(path("orbit") / name, path("again") / name), 1);
}

TEST_F(Render, ASplineBeginsAndEndsWithTheCamerasThatWereNamed) {
  expect_done("--path spline --through view_4,1,view_2.png --frames 5 -o " + text("spline"));
  const auto run = read_cameras(path("run/cameras.json"), Vec3d(0.0));
  const auto place_of = [&](const std::string& name) {
    for (const NamedCamera& named : run)
      if (named.name == name) return named.camera.position();
    throw Error("no " + name);
  };
  const auto spline = places("spline/cameras.json");
  ASSERT_EQ(spline.size(), 5u);
  EXPECT_LT(distance(spline[0], place_of("view_4")), 1e-5);
  EXPECT_LT(distance(spline[4], place_of("view_2")), 1e-5);
  expect_refused("--path spline --through view_4,view_22 -o " + text("none"),
                 "did you mean view_2");
  expect_refused("--path spline --through 99,view_4 -o " + text("none"), "99");
  expect_refused("--path spline --through view_4 -o " + text("none"), "two cameras");
}

TEST_F(Render, APathOfKeyFramesPassesThem) {
  const auto key = [](double x, double z) {
    return fmt::format(
        R"({{"img_name":"key","width":40,"height":30,"fx":40,"fy":40,"position":[{},0,{}],
      "rotation":[[1,0,0],[0,1,0],[0,0,1]]}})",
        x, z);
  };
  const auto file = [&](const std::string& keys, const std::string& more = "") {
    write_bytes(path("path.json"), R"({"format":"gemsplat key frames","version":1,"seconds":0.5,)" +
                                       more + R"("keys":[)" + keys + "]}");
    return text("path.json");
  };
  const std::string two = key(0, 0) + "," + key(1, -1);
  expect_done("--path " + file(two) + " --fps 10 -o " + text("open"));
  auto places_of = places("open/cameras.json");
  ASSERT_EQ(places_of.size(), 5u) << "half a second";
  EXPECT_LT(distance(places_of[0], Vec3f(0, 0, 0)), 1e-5);
  EXPECT_LT(distance(places_of[4], Vec3f(1, 0, -1)), 1e-5);
  expect_done("--path " + file(two + "," + key(0, -2), R"("closed":true,"pace":"keys",)") +
              " --frames 6 -o " + text("closed"));
  places_of = places("closed/cameras.json");
  ASSERT_EQ(places_of.size(), 6u);
  EXPECT_LT(distance(places_of[2], Vec3f(1, 0, -1)), 1e-5) << "a third of the way";
  EXPECT_GT(distance(places_of[5], places_of[0]), 0.1) << "one step before the begin";
  const std::string out = " -o " + text("none");
  expect_refused("--path " + text("nothing.json") + out, "no such file");
  expect_refused("--path " + file(two) + " --split test" + out, "leave --cameras and --split out");
  expect_refused("--path " + file(two) + " --turns 2" + out, "only with --path orbit");
  EXPECT_THAT(render("--path " + file(key(0, 0)) + out).err,
              AllOf(HasSubstr("path.json"), HasSubstr("fewer than two keys")));
  EXPECT_THAT(render("--path " + file(two, R"("pace":"slow",)") + out).err, HasSubstr("its pace"));
  EXPECT_THAT(render("--path " + file(two, R"("closed":1,)") + out).err, HasSubstr("closed"));
  write_bytes(path("path.json"), R"({"format":"gemsplat key frames","version":2})");
  EXPECT_THAT(render("--path " + text("path.json") + out).err, HasSubstr("update gemsplat"));
  write_bytes(path("path.json"), "[1]");
  EXPECT_THAT(render("--path " + text("path.json") + out).err, HasSubstr("path.json"));
}

TEST_F(Render, APathOfNoNumbersIsRefused) {
  expect_refused("--path orbit --turns nan -o " + text("none"), "turns");
  expect_refused("--path orbit --center nan 0 0 -o " + text("none"), "center");
}

TEST_F(Render, AFlythroughStaysAmongTheTrainingCameras) {
  expect_done("--path flythrough --keys 3 --seconds 0.4 --fps 20 -o " + text("tour"));
  const auto tour = places("tour/cameras.json");
  ASSERT_EQ(tour.size(), 8u);
  for (const Vec3f& place : tour) {  // the cameras stand on a line, 0.1 apart
    EXPECT_NEAR(place.y, 0, 1e-5);
    EXPECT_GT(place.x, -0.1);
    EXPECT_LT(place.x, 0.6);
  }
  const auto through = json("tour/film.json").at("path").at("through");
  EXPECT_EQ(through.size(), 3u);
  // those are for testing
  for (const auto& name : through) EXPECT_TRUE(name != "view_0" && name != "view_3") << name;
}

TEST_F(Render, AFilmHasAllFramesAndAFileBesideIt) {
  if (!can_write_films()) GTEST_SKIP() << cannot_write_films();
  expect_done("--path spline --frames 7 --fps 12 --write color,depth -o " + text("film.mp4"));
  for (const char* name : {"film.mp4", "film.depth.mp4"})
    EXPECT_EQ(count_frames(path(name)), 7) << name;
  const auto film = json("film.json");
  EXPECT_EQ(film.at("fps"), 12);
  EXPECT_EQ(film.at("width"), kWidth);
  EXPECT_EQ(film.at("pictures").at("depth").at(0), "film.depth.mp4");
  EXPECT_EQ(film.at("model").at("gaussians"), json("run/results.json").at("num_gaussians"));
  EXPECT_LT(film.at("depth_range").at(0), film.at("depth_range").at(1));
  EXPECT_EQ(places("film.cameras.json").size(), 7u);

  // The same frames as pictures differ only by the codec.
  expect_done("--cameras " + text("film.cameras.json") + " -o " + text("frames"));
  const auto names = take_frames(path("film.mp4"), 7, 7, path("decoded"), "f", {});
  ASSERT_EQ(names.size(), 7u);
  for (int i = 0; i < 7; ++i) {
    const Image8 a = read_photo(path("decoded") / names[std::size_t(i)]);
    const Image8 b = read_photo(path("frames") / ("0000" + std::to_string(i) + ".png"));
    ASSERT_EQ(a.pixels.size(), b.pixels.size());
    double sum = 0;
    for (std::size_t k = 0; k < a.pixels.size(); ++k)
      sum += std::abs(int(a.pixels[k]) - int(b.pixels[k]));
    EXPECT_LT(sum / double(a.pixels.size()), 6) << i;
  }
}

TEST_F(Render, AFilmOfViewsHasOneSizeWithEvenSides) {
  if (!can_write_films()) GTEST_SKIP() << cannot_write_films();
  const Outcome outcome = render("--size 31x23 --fps 2 -o " + text("odd.mp4"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("31x23 becomes 30x22"));
  EXPECT_EQ(count_frames(path("odd.mp4")), kViews);
  EXPECT_EQ(json("odd.json").at("width"), 30);
  expect_refused("-o " + text("film.webm"), ".mp4");
  expect_refused("-o " + text("picture.png"), "pictures go into a folder");
}

TEST_F(Render, NothingIsOverwritten) {
  expect_done("--split test -o " + text("a"));
  const std::string picture = read_bytes(path("a/view_3.png"));
  expect_refused("--split test -w -o " + text("a"), "view_0.png is there already");
  EXPECT_EQ(read_bytes(path("a/view_3.png")), picture);
  expect_done("--split test -w --force -o " + text("a"));
  EXPECT_EQ(read_bytes(path("a/view_3.png.bak-1")), picture);
  if (!can_write_films()) return;
  write_bytes(path("b.cameras.json"), "somebody's");
  expect_refused("-o " + text("b.mp4"), "b.cameras.json is there already");
  EXPECT_FALSE(fs::exists(path("b.mp4")));
  expect_done("--force -o " + text("b.mp4"));
  EXPECT_EQ(read_bytes(path("b.cameras.json.bak-1")), "somebody's");
}

TEST_F(Render, ViewsOfOneNameAreNotWrittenOverEachOther) {
  SortedJson cameras = json("run/cameras.json");
  cameras[1]["img_name"] = cameras[0]["img_name"];
  write_bytes(path("twice.json"), cameras.dump());
  expect_refused("--cameras " + text("twice.json") + " -o " + text("a"), "two views");
}

TEST_F(Render, FlagsThatDoNotFitAreUsageErrors) {
  const std::string out = " -o " + text("none");
  expect_refused("--frames 9" + out, "--path");
  expect_refused("--turns 2 --path spline" + out, "--turns works only with --path orbit");
  expect_refused("--path orbit --through 1,2" + out, "--through works only with --path spline");
  expect_refused("--path orbit --turns 0" + out, "--turns");
  expect_refused("--path circle" + out, "circle");
  expect_refused("--size 12" + out, "1280x720");
  expect_refused("--size 12x0" + out, "1280x720");
  expect_refused("--size 70000x10" + out, "65520");
  write_bytes(path("empty.json"), "[]");
  expect_refused("--path orbit --cameras " + text("empty.json") + out, "no camera", 3);
  expect_refused("--depth-range 5 2 --write depth" + out, "nearer");
  expect_refused("--split test --cameras " + text("run/cameras.json") + out, "--split");
  expect_refused("--cameras " + text("scene/images") + out, "no cameras in", 3);
  expect_refused("-o " + text("run/cameras.json"), "is a file");
  EXPECT_FALSE(fs::exists(path("none")));
}

// The numbers of photometric.json, here of a photo that is half as bright in red.
TEST_F(Render, ColorsAreThoseOfAPhotoIfItIsNamed) {
  expect_refused("--like view_1.png -o " + text("none"), "photometric.json");
  ASSERT_EQ(train("gains", "--set photometric.model=gains").code, 0);
  SortedJson looks = json("gains/photometric.json");
  auto& photo = looks.at("photos").at("view_1.png");
  photo["log_gain_red"] = std::log(0.5);
  photo["log_gain_green"] = photo["log_gain_blue"] = 0;
  write_bytes(path("gains/photometric.json"), looks.dump());
  const auto of_gains = [&](const std::string& more) {
    return run("render " + text("gains") + " --device cpu " + more);
  };
  ASSERT_EQ(of_gains("-o " + text("neutral")).code, 0);
  const Outcome like = of_gains("--like view_1.png -o " + text("like"));
  ASSERT_EQ(like.code, 0) << like.err;
  const Image8 neutral = read_photo(path("neutral/view_2.png"));
  const Image8 shown = read_photo(path("like/view_2.png"));
  for (std::size_t i = 0; i < neutral.pixels.size(); ++i)
    EXPECT_NEAR(shown.pixels[i], neutral.pixels[i] * (i % 3 == 0 ? 0.5 : 1.0), 1) << i;
  ASSERT_EQ(of_gains("--like each -o " + text("each")).code, 0);
  EXPECT_EQ(read_photo(path("each/view_1.png")).pixels, read_photo(path("like/view_1.png")).pixels);
  EXPECT_NE(read_photo(path("each/view_2.png")).pixels, shown.pixels);
  const Outcome unknown = of_gains("--like nobody.png -o " + text("none"));
  EXPECT_EQ(unknown.code, 2);
  EXPECT_THAT(unknown.err, AllOf(HasSubstr("no photo nobody.png"), HasSubstr("view_")));
}

TEST_F(Render, AFieldOfViewZoomsAndASizeKeepsAllThatWasSeen) {
  expect_done("--path orbit --frames 1 --fov 90 --size 50x20 -o " + text("wide"));
  const Camera camera = read_cameras(path("wide/cameras.json"), Vec3d(0.0)).at(0).camera;
  EXPECT_NEAR(camera.fx, 25, 1e-3);
  EXPECT_NEAR(camera.fy, 25, 1e-3);
  expect_done("--path orbit --frames 1 --size 80x32 -o " + text("same"));
  const Camera same = read_cameras(path("same/cameras.json"), Vec3d(0.0)).at(0).camera;
  EXPECT_NEAR(same.fy, 40, 1e-3);  // as high as before, so no larger
  EXPECT_NEAR(same.cx, 40, 1e-3);
}

TEST_F(Render, APanoramaSaysThatItIsOne) {
  expect_done("--lens equirectangular --size 96x48 --split test --write color,depth -o " +
              text("all"));
  EXPECT_EQ(read_photo(path("all/view_0.png")).width, 96);
  EXPECT_TRUE(is_panorama(path("all/view_0.png"), {96, 48}));
  expect_done("--split test -o " + text("flat"));
  EXPECT_FALSE(is_panorama(path("flat/view_0.png"), {96, 48}));
  if (!can_write_films()) return;
  expect_done("--lens equirectangular --size 96x48 --path orbit --frames 3 -o " + text("film.mp4"));
  EXPECT_THAT(read_bytes(path("film.mp4")),
              HasSubstr("<GSpherical:ProjectionType>equirectangular"));
  EXPECT_EQ(count_frames(path("film.mp4")), 3);
  EXPECT_EQ(json("film.json")["lens"], "equirectangular");
}

TEST_F(Render, OtherLensesChangeWhatIsSeen) {
  expect_done("--split test -o " + text("own"));
  for (const char* lens : {"fisheye", "orthographic"}) {
    expect_done(std::string("--split test --lens ") + lens + " -o " + text(lens));
    EXPECT_GT(largest_difference(path("own/view_0.png"), path(lens) / "view_0.png"), 20) << lens;
  }
  // Twice as wide, everything is half as large.
  for (const char* width : {"8", "16"})
    expect_done(std::string("--split test --write alpha --lens orthographic --across ") + width +
                " -o " + text(width));
  const auto covered = [&](const char* width) {
    const Image8 alpha = read_photo(path(width) / "view_0.png");
    return std::accumulate(alpha.pixels.begin(), alpha.pixels.end(), 0.0);
  };
  EXPECT_LT(covered("16"), 0.6 * covered("8"));
}

TEST_F(Render, AnOrthophotoHasAWorldFileForEachPicture) {
  const std::string flags = "--lens orthographic --meters-per-pixel 0.1";
  expect_refused(flags + " -o " + text("none"), "gemsplat georef");
  write_georef(path("georef.json"), {{{15.9, -48.2, 300}, {}}, "a test"});
  const std::string georef = " --georef " + text("georef.json");
  expect_done(flags + georef + " --write color,depth -o " + text("map"));
  for (const char* name : {"orthophoto", "orthophoto.depth"}) {
    EXPECT_TRUE(fs::exists(path("map") / (std::string(name) + ".png"))) << name;
    EXPECT_THAT(read_bytes(path("map") / (std::string(name) + ".pgw")),
                testing::StartsWith("0.1\n0\n0\n-0.1\n"))
        << name;
  }
  expect_refused(flags + georef + " -o " + text("map"), "--force");
}

TEST_F(Render, FlagsThatDoNotFitALensAreUsageErrors) {
  const std::string out = " -o " + text("none");
  expect_refused("--fov 160" + out, "--lens fisheye");
  expect_refused("--lens fisheye --fov 340" + out, "corners");
  expect_refused("--lens equirectangular --fov 90" + out, "--fov does not go with");
  expect_refused("--lens equirectangular --size 100x60" + out, "4096x2048");
  expect_refused("--across 3" + out, "--lens orthographic");
  expect_refused("--meters-per-pixel 1" + out, "--lens orthographic");
  expect_refused("--lens fisheye --write normal" + out, "normals");
  EXPECT_FALSE(fs::exists(path("none")));
}

}  // namespace
}  // namespace gs
