// SPDX-License-Identifier: Apache-2.0
// gemsplat export and train --export as users run them, and other verbs on the files that they
// write.
#include <gmock/gmock.h>

#include "gs_core/geodesy/utm.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/spz/spz.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class Export : public Program {
 protected:
  void SetUp() override {
    const auto build = SortedJson::parse(run("info --json").out);
    for (const char* library : {"zlib", "libwebp"})
      if (!build[library]["available"].get<bool>()) GTEST_SKIP() << "this build has no " << library;
  }
  Outcome export_run(const std::string& more) {
    return run("export " + text("run") + " " + more + " --device cpu");
  }
  // The scene of the other tests, moved to UTM coordinates.
  void write_far_scene() const {
    write_scene(path("scene"));
    std::istringstream images(read_bytes(path("scene/sparse/0/images.txt")));
    std::string moved, line;
    for (int v = 0; std::getline(images, line);
         ++v)  // every second line is an empty list of points
      moved += v % 2 ? "\n"
                     : std::to_string(v / 2 + 1) + " 1 0 0 0 " +
                           std::to_string(-500000.0 - 0.1 * (v / 2)) + " -5400000 -300 1 view_" +
                           std::to_string(v / 2) + ".png\n";
    write_bytes(path("scene/sparse/0/images.txt"), moved);
    std::ostringstream points;
    for (int p = 0; p < kPoints; ++p)
      points << std::fixed << p + 1 << ' ' << 500000.0 + point(p).x << ' ' << 5400000.0 + point(p).y
             << ' ' << 300.0 + point(p).z << " 120 130 140 0.5\n";
    write_bytes(path("scene/sparse/0/points3D.txt"), points.str());
  }
  // An entry of the product of two matrices of a sidecar.
  static double entry(const SortedJson& a, const SortedJson& b, int i, int j) {
    double sum = 0;
    for (int k = 0; k < 4; ++k) sum += a[i][k].get<double>() * b[k][j].get<double>();
    return sum;
  }
};

TEST_F(Export, SpzTakesItsVersionAndBitsOfShFromFlags) {
  train("run");
  ASSERT_EQ(export_run(text("a.spz") + " --spz-version 2 --spz-sh-bits 8 --no-measure").code, 0);
  ASSERT_EQ(export_run(text("b.spz") + " --spz-sh-bits 8 --no-measure").code, 0);
  EXPECT_THAT(run("info " + text("a.spz")).out, HasSubstr("Gaussians"));
  EXPECT_NE(read_bytes(path("a.spz")), read_bytes(path("b.spz")));
  EXPECT_NE(export_run(text("c.spz") + " --spz-sh-bits 9").code, 0);
  EXPECT_NE(export_run(text("c.spz") + " --spz-version 5").code, 0);
  EXPECT_FALSE(fs::exists(path("c.spz")));
}

TEST_F(Export, AModelPageHoldsSceneAndModelAndReplacesNothing) {
  train("run");
  const Outcome outcome = export_run(text("page.html"));
  if (outcome.err.find("npm was missing") != std::string::npos) GTEST_SKIP() << outcome.err;
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("a browser opens it"));
  const std::string page = read_bytes(path("page.html"));
  const auto element = [&](const std::string& begin) {
    const std::size_t at = page.find(begin);
    EXPECT_NE(at, page.npos) << begin;
    return page.substr(at + begin.size(), page.find("</script>", at) - at - begin.size());
  };
  const auto scene =
      SortedJson::parse(element("<script id=\"gemsplat-scene\" type=\"application/json\">"));
  EXPECT_EQ(scene["mode"], "file");
  EXPECT_EQ(scene["model"]["format"], "sog");
  EXPECT_GT(scene["cameras"].size(), 0u);
  EXPECT_TRUE(scene["cameras"][0]["photo"].is_null());
  EXPECT_EQ(scene["title"], "scene") << "the folder that it was trained on";
  EXPECT_EQ(scene["visitors"], true);
  EXPECT_GE(scene["turn"]["width"], 0);
  EXPECT_THAT(page, HasSubstr("<title>scene</title>"));
  const std::string model = element("<script id=\"gemsplat-model\" type=\"text/plain\">");
  EXPECT_THAT(model, testing::StartsWith("UEsD"));  // "PK\3" of a zip file
  EXPECT_EQ(model.size(), (scene["model"]["bytes"].get<std::size_t>() + 2) / 3 * 4);
  EXPECT_EQ(page.find("<script id=\"gemsplat-scene\""),
            page.rfind("<script id=\"gemsplat-scene\""));
  EXPECT_THAT(export_run(text("page.html")).err, HasSubstr("is there already"));
  EXPECT_EQ(read_bytes(path("page.html")), page);
  ASSERT_EQ(export_run(text("page.html") + " --force").code, 0);
  EXPECT_TRUE(fs::exists(path("page.html.bak-1")));
  ASSERT_EQ(export_run(text("named.html") + " --title 'A <b> & c'").code, 0);
  EXPECT_THAT(read_bytes(path("named.html")), AllOf(HasSubstr("<title>A &lt;b> &amp; c</title>"),
                                                    HasSubstr("\"title\":\"A \\u003cb> & c\"")));
  fs::copy(path("scene"), path("run/scene"), fs::copy_options::recursive);
  std::string config = read_bytes(path("run/config.toml"));
  const std::string source = path("scene").string();
  write_bytes(path("run/config.toml"),
              config.replace(config.find(source), source.size(), path("run/scene").string()));
  ASSERT_EQ(export_run(text("photos.html")).code, 0);
  EXPECT_THAT(read_bytes(path("photos.html")), HasSubstr("<title>run</title>"))
      << "as of `train PHOTOS`";
  EXPECT_THAT(export_run(text("a.ply") + " --title x").err, HasSubstr("ends in .html"));
  EXPECT_THAT(export_run(text("moved.html") + " --recenter").err,
              HasSubstr("export a moved model first"));
}

TEST_F(Export, LossyFilesAreMeasuredOnTheTestViewsAndRecorded) {
  train("run");
  const Outcome outcome = export_run(text("a.spz") + " " + text("a.ply"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("bytes per Gaussian; "), HasSubstr("dB PSNR"),
                                 HasSubstr("against the model on 2 test views")));
  const auto sidecar = json("a.spz.transforms.json");
  EXPECT_EQ(sidecar["format"], "spz");
  EXPECT_EQ(sidecar["bytes"], fs::file_size(path("a.spz")));
  EXPECT_GT(sidecar["fidelity"]["psnr"], 30);
  EXPECT_GT(sidecar["fidelity"]["ssim"], 0.9);
  EXPECT_EQ(sidecar["axes"]["y"], "up");
  EXPECT_FALSE(json("a.ply.transforms.json").contains("fidelity"));
  EXPECT_EQ(read_bytes(path("a.ply")),
            read_bytes(path("run/point_cloud/iteration_20/point_cloud.ply")));
}

TEST_F(Export, OtherVerbsTakeWhatWasWritten) {
  train("run");
  export_run(text("a.spz") + " " + text("a.sog") + " " + text("a.compressed.ply"));
  for (const char* name : {"a.spz", "a.sog", "a.compressed.ply"}) {
    EXPECT_THAT(run("info " + text(name)).out, HasSubstr("150")) << name;
    EXPECT_THAT(
        run("eval " + text(name) + " --data " + text("scene") + " --test-every 3 --device cpu").out,
        HasSubstr("over 2 views"))
        << name;
  }
}

TEST_F(Export, FilesThatAreThereAreRefusedOrMovedAside) {
  train("run");
  write_bytes(path("a.splat"), "somebody's");
  const Outcome refused = export_run(text("b.spz") + " " + text("a.splat"));
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("a.splat is there already"), HasSubstr("--force")));
  EXPECT_FALSE(fs::exists(path("b.spz")));  // nothing was begun
  EXPECT_EQ(export_run(text("a.splat") + " --force").code, 0);
  EXPECT_EQ(read_bytes(path("a.splat.bak-1")), "somebody's");
}

TEST_F(Export, NamesWithoutAFormatAreUsageErrorsThatListThem) {
  train("run");
  const Outcome outcome = export_run(text("a.obj"));
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(
      outcome.err,
      HasSubstr("gemsplat does not write .obj; it writes .ply, .glb, .compressed.ply, .spz, "
                ".sog, .rad, .npz, .extreme_saving.zip, .splat, .usda, .usdc, .usdz"));
  EXPECT_THAT(outcome.err, HasSubstr("a page (.html)"));
  EXPECT_EQ(run("train " + text("scene") + " -o " + text("b") + kTrain + " --export obj").code, 2);
  EXPECT_FALSE(fs::exists(path("b")));
}

TEST_F(Export, APlacedModelIsMeasuredWhereItWasAndItsMatricesInvert) {
  train("run");
  const Outcome outcome =
      export_run(text("a.compressed.ply") + " --recenter --scale 3 --up 0.1,0.2,-1");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const auto sidecar = json("a.compressed.ply.transforms.json");
  EXPECT_GT(sidecar["fidelity"]["psnr"],
            28);  // one chunk of 150 Gaussians; turned wrongly: below 20
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      EXPECT_NEAR(entry(sidecar["input_from_file"], sidecar["file_from_input"], i, j), i == j,
                  1e-9);
  EXPECT_NEAR(sidecar["input_from_file"][3][3], 1, 1e-12);
}

TEST_F(Export, LossesAreMeasuredAtTheCamerasOfASceneWithoutDecodingItsPhotos) {
  train("run");
  damage_photos(path("scene/images"));
  const Outcome outcome = export_run("--data " + text("scene") + " " + text("a.compressed.ply"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("dB PSNR"));
}

TEST_F(Export, ALowerShDegreeIsInTheFileAndItsLossIsMeasured) {
  train("run", "--iterations 60 --set train.sh_degree_every=5");
  const Outcome outcome =
      export_run("--sh-degree 0 " + text("low.ply") + " " + text("low.compressed.ply"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  ASSERT_EQ(export_run(text("full.ply") + " " + text("full.compressed.ply")).code, 0);
  for (const char* ending : {"ply", "compressed.ply"})
    EXPECT_LT(2 * fs::file_size(path(std::string("low.").append(ending))),
              fs::file_size(path(std::string("full.").append(ending))));
  const auto info = SortedJson::parse(run("info --json " + text("low.ply")).out);
  EXPECT_EQ(info["sh_degree"], 0);
  const auto sidecar = json("low.ply.transforms.json");
  EXPECT_EQ(sidecar["sh_degree"], 0);
  EXPECT_LT(sidecar["fidelity"]["psnr"], 100);  // against the model with all its coefficients
  EXPECT_FALSE(json("full.ply.transforms.json").contains("fidelity"));
}

TEST_F(Export, TheOffsetOfAFarSceneIsNamed) {
  write_far_scene();
  ASSERT_EQ(train("run").code, 0);
  const Outcome outcome = export_run(text("a.splat") + " --no-measure");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("a.splat lies near the origin"),
                                 HasSubstr("a.splat.transforms.json has the matrix")));
  const auto offset = json("run/world_offset.json")["world_offset"];
  EXPECT_NEAR(offset[1].get<double>(), 5400000, 100);
  EXPECT_EQ(json("a.splat.transforms.json")["input_from_file"][1][3], offset[1]);
}

/// A 4x4 matrix of a sidecar, by rows, times (x y z 1).
Vec3d times(const SortedJson& matrix, const Vec3d& x) {
  Vec3d result;
  for (int i = 0; i < 3; ++i)
    result[i] = matrix[i][0].get<double>() * x.x + matrix[i][1].get<double>() * x.y +
                matrix[i][2].get<double>() * x.z + matrix[i][3].get<double>();
  return result;
}

TEST_F(Export, SidecarsOfAFarSceneLeadToTheEarth) {
  write_far_scene();
  ASSERT_EQ(train("run").code, 0);
  ASSERT_EQ(run("georef " + text("scene") + " --crs EPSG:32633").code, 0);
  ASSERT_EQ(export_run(text("a.ply") + " " + text("a.spz") + " --no-measure").code, 0);
  ASSERT_EQ(export_run(text("b.ply") + " --recenter --up 1,2,3 --scale 0.5").code, 0);
  const GaussianModel plain = read_model(path("a.ply")), turned = read_model(path("b.ply")),
                      packed = read_spz(path("a.spz"));
  for (std::size_t i = 0; i < plain.gaussians.count(); ++i) {
    const Vec3d utm = Vec3d(plain.gaussians.mean[i]) + plain.world_offset;
    const auto off = [&](const std::string& file, const Vec3d& at) {
      const Vec3d there =
          times(json(file + ".transforms.json")["georeference"]["ecef_from_file"], at);
      return length(there - ecef_of(geodetic_of_utm({33, false}, utm)));
    };
    // The scene is some meters deep, so a height differs by 2 mm between UTM and its similarity.
    EXPECT_LT(off("a.ply", Vec3d(plain.gaussians.mean[i])), 0.005);
    EXPECT_LT(off("b.ply", Vec3d(turned.gaussians.mean[i])), 0.005);
    // read_spz() turns the file's axes to the PLY's: half a turn about x.
    EXPECT_LT(off("a.spz", Vec3d(packed.gaussians.mean[i] * Vec3f(1, -1, -1))), 0.005);
  }
}

TEST_F(Export, ANameThatEndsInASlashIsATileset) {
  train("run");
  const Outcome without = export_run(text("tiles/"));
  EXPECT_EQ(without.code, 2);
  EXPECT_THAT(without.err, AllOf(HasSubstr("gemsplat georef"), HasSubstr("--georef")));
  ASSERT_EQ(run("georef " + text("scene") + " --origin 15.5,48.2,300").code, 0);
  const Outcome outcome = export_run(text("tiles/") + " --tile-gaussians 100");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("150 Gaussians in 3 tiles of 2 levels"));
  EXPECT_TRUE(fs::exists(path("tiles/1/1.glb")));
  EXPECT_EQ(export_run(text("tiles/")).code, 2);
  EXPECT_EQ(export_run(text("tiles/") + " --force").code, 0);
  EXPECT_TRUE(fs::exists(path("tiles.bak-1/1/1.glb")));
  EXPECT_FALSE(fs::exists(path("tiles/1/1.glb")));
  EXPECT_THAT(export_run(text("other/") + " --scale 2").err, HasSubstr("--scale"));
  EXPECT_EQ(export_run(text("run/") + " --force").code, 2);  // it holds the model
  EXPECT_THAT(export_run(text("other/") + " " + text("run/../other/")).err, HasSubstr("twice"));
  write_bytes(path("scene/georef.json"), "{");
  EXPECT_THAT(export_run(text("other/")).err,
              AllOf(HasSubstr("georef.json"), HasSubstr("gemsplat georef")));
  EXPECT_FALSE(fs::exists(path("other")));
}

TEST_F(Export, AFolderThatHoldsWhatIsReadIsNotMoved) {
  train("run");
  ASSERT_EQ(run("georef " + text("scene") + " --origin 15.5,48.2,300").code, 0);
  const auto is_refused = [&](const std::string& more) {
    const Outcome refused = export_run(more + " --force --no-measure");
    EXPECT_EQ(refused.code, 2) << more << refused.err;
    EXPECT_THAT(refused.err, HasSubstr("which this command reads")) << more;
    EXPECT_FALSE(fs::exists(path("scene.bak-1")) || fs::exists(path("tx.bak-1"))) << more;
  };
  is_refused(text("scene/"));  // the run's scene, which says where it stands
  fs::create_directories(path("tx"));
  fs::copy(path("scene/georef.json"), path("tx/georef.json"));
  is_refused(text("tx/") + " --georef " + text("tx/georef.json"));
  write_bytes(path("tx/more.toml"), "");
  is_refused(text("tx/") + " -c " + text("tx/more.toml"));
  EXPECT_TRUE(fs::exists(path("scene/images/view_0.png")));
}

TEST_F(Export, TheTableHasEveryFormat) {
  train("run");
  const Outcome outcome = export_run(text("all") + " --table");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(read_bytes(path("all/formats.md")), outcome.out.substr(outcome.out.find("| format")));
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("| compressed.ply |"), HasSubstr("| splat |")));
}

TEST_F(Export, ATableThatIsThereIsRefusedOrMovedAside) {
  train("run");
  write_bytes(path("all/formats.md"), "somebody's");
  EXPECT_EQ(export_run(text("all") + " --table").code, 2);
  EXPECT_EQ(read_bytes(path("all/formats.md")), "somebody's");
  EXPECT_EQ(export_run(text("all") + " --table --force").code, 0);
  EXPECT_EQ(read_bytes(path("all/formats.md.bak-1")), "somebody's");
}

TEST_F(Export, OneFileNamedTwiceIsAnError) {
  train("run");
  fs::create_directory_symlink(path("run"), path("link"));
  EXPECT_THAT(export_run(text("run/a.spz") + " " + text("link/a.spz")).err, HasSubstr("twice"));
  EXPECT_THAT(train("other", "--export spz,splat,spz").err, HasSubstr("names spz twice"));
  const Outcome outcome = export_run(text("a.spz") + " " + text("./a.spz"));
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(outcome.err, HasSubstr("named twice"));
  EXPECT_FALSE(fs::exists(path("a.spz")));
}

TEST_F(Export, AStageOfUsdHasTheCamerasOfTheRunAndIsRead) {
  train("run");
  for (const char* name : {"a.usda", "a.usdc", "a.usdz"}) {
    const Outcome outcome = export_run(text(name) + " --recenter");
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_THAT(outcome.out, HasSubstr("100.00 dB PSNR"));
    const std::string stage = read_bytes(path(name));
    for (int view = 0; view < kViews; ++view)
      EXPECT_THAT(stage,
                  HasSubstr("view_" + std::to_string(view) + "_view_" + std::to_string(view)));
    EXPECT_EQ(run("eval " + text(name) + " --data " + text("scene") + " --device cpu").code, 0);
  }
}

// Runs of the reference trainer are like this.
TEST_F(Export, CodebooksOfNpzAreWeightedByTrainingViewsWhereThereAreAny) {
  train("run");
  const Outcome measured = export_run(text("a.npz"));
  ASSERT_EQ(measured.code, 0) << measured.err;
  EXPECT_THAT(measured.out, HasSubstr("against the model on 2 test views"));
  ASSERT_EQ(export_run(text("b.npz") + " --no-measure").code, 0);
  EXPECT_EQ(json("a.npz.transforms.json")["gaussians"], json("b.npz.transforms.json")["gaussians"]);
  EXPECT_EQ(run("eval " + text("a.npz") + " --data " + text("scene") + " --device cpu").code, 0);
}

TEST_F(Export, RunsWithoutASplitOrCamerasAreExported) {
  train("run");
  fs::remove(path("run/split.json"));
  const Outcome all = export_run(text("a.spz"));
  EXPECT_EQ(all.code, 0) << all.err;
  EXPECT_THAT(all.out, HasSubstr("on all 6 views"));
  fs::remove(path("run/cameras.json"));
  const Outcome none = export_run(text("b.spz"));
  EXPECT_EQ(none.code, 0) << none.err;
  EXPECT_THAT(none.err, HasSubstr("there are no views"));
}

TEST_F(Export, WhatAFormatCannotSayIsReadFromItsSidecar) {
  train("run", "--antialiased");
  export_run(text("a.splat") + " " + text("b.splat") + " --no-measure");
  fs::remove(path("b.splat.transforms.json"));
  const auto antialiased = [&](const std::string& name) {
    return SortedJson::parse(run("eval " + text(name) + " --data " + text("scene") +
                                 " --test-every 3 --json --device cpu")
                                 .out)["psnr"]
        .get<double>();
  };
  EXPECT_NE(antialiased("a.splat"), antialiased("b.splat"));  // rendered as it was trained, and not
}

TEST_F(Export, TrainWritesTheFormatsBesideThePly) {
  const Outcome outcome = train("run", "--export ply,spz,glb");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const std::string folder = "run/point_cloud/iteration_20/point_cloud.";
  EXPECT_TRUE(fs::exists(path(folder + "spz")));
  EXPECT_TRUE(fs::exists(path(folder + "glb")));
  EXPECT_THAT(outcome.err, HasSubstr("against the model on 2 test views"));
  EXPECT_EQ(json(folder + "spz.transforms.json")["fidelity"]["num_views"], 2);
}

TEST_F(Export, WithoutViewsNothingIsMeasuredAndThatIsSaid) {
  train("run");
  const Outcome outcome =
      run("export " + text("run/point_cloud/iteration_20/point_cloud.ply") + " " + text("a.splat"));
  EXPECT_EQ(outcome.code, 0);
  EXPECT_THAT(outcome.err, HasSubstr("--data SCENE"));
  EXPECT_THAT(outcome.out, Not(HasSubstr("PSNR")));
}

}  // namespace
}  // namespace gs
