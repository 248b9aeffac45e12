// SPDX-License-Identifier: Apache-2.0
// gemsplat mesh: files, options and everything that it refuses.
#include <gmock/gmock.h>
#include <spdlog/fmt/fmt.h>

#include "data_loaders/photos/photos.h"
#include "gs_model/formats/formats.h"
#include "gs_model/mesh/mesh_read.h"
#include "tests/support/depth_png.h"
#include "tests/support/program.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class MeshVerb : public Program {
 protected:
  /// A run whose model is a wall of opaque Gaussians, three units in front of its cameras.
  void make_wall() {
    ASSERT_EQ(train("out", "-q").code, 0);
    GaussianModel wall{Gaussians(41 * 41, host_memory()), 0, true, false};
    for (std::size_t i = 0; i < wall.gaussians.count(); ++i)
      set_gaussian(wall.gaussians, i, {0.1f * (float(i % 41) - 20), 0.1f * (float(i / 41) - 20), 3},
                   0.06f, 0.99f);
    write_model(path("wall.ply"), wall);
  }
  std::string mesh(const std::string& output, const std::string& more = "") {
    return "mesh " + text("wall.ply") + " --cameras " + text("out/cameras.json") + " -o " +
           text(output) + " " + more;
  }
};

TEST_F(MeshVerb, WritesEveryFormatWithTheSameBytesForAnyThreads) {
  make_wall();
  for (const std::string ending : {"glb", "obj", "ply", "stl"}) {
    const Outcome outcome = run(mesh("one." + ending, "--threads 1 --watertight"));
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_THAT(outcome.out, AllOf(HasSubstr("triangles"), HasSubstr("look at it: xdg-open")));
    ASSERT_EQ(run(mesh("four." + ending, "--threads 4 --watertight")).code, 0);
    EXPECT_EQ(read_bytes(path("one." + ending)), read_bytes(path("four." + ending)));
  }
}

TEST_F(MeshVerb, TakesARunAndSaysWhatItWrote) {
  make_wall();
  const std::filesystem::path model = path("out/point_cloud/iteration_20/point_cloud.ply");
  std::filesystem::copy_file(path("wall.ply"), model,
                             std::filesystem::copy_options::overwrite_existing);
  const Outcome outcome = run("mesh " + text("out") + " --json");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Json json = Json::parse(outcome.out);
  EXPECT_EQ(json["output"], text("out-mesh.glb"));
  EXPECT_EQ(json["views"], 4);
  EXPECT_GT(json["triangles"], 100);
  EXPECT_EQ(json["pieces"], 1);
  EXPECT_TRUE(std::filesystem::exists(path("out-mesh.glb")));
}

TEST_F(MeshVerb, DrawsSmallerViewsForCoarseVoxels) {
  make_wall();
  const auto made = [&](const std::string& more) {
    const Outcome outcome = run(mesh("coarse.ply", "--force --json " + more));
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return Json::parse(outcome.out);
  };
  const double voxel = made("")["voxel"];
  const std::string coarse = fmt::format("--voxel {}", 2.5 * voxel);
  EXPECT_EQ(made("")["views_divided_by"], 1);
  EXPECT_EQ(made(fmt::format("--voxel {}", 1.5 * voxel))["views_divided_by"], 1);
  EXPECT_EQ(made(coarse + " -r 1")["views_divided_by"], 1);
  EXPECT_EQ(made(coarse)["views_divided_by"], 2);
  for (const Vec3f& at : read_mesh(path("coarse.ply")).mesh.vertices) EXPECT_NEAR(at.z, 3, voxel);
}

TEST_F(MeshVerb, WritesATextureIntoAGlbOrBesideAnObj) {
  make_wall();
  const Outcome glb = run(mesh("wall.glb", "--texture 256 --decimate 200 --json"));
  ASSERT_EQ(glb.code, 0) << glb.err;
  const Json json = Json::parse(glb.out);
  EXPECT_LE(json["texture"][0], 256);
  EXPECT_GT(json["texture"][0], 32);
  EXPECT_GT(json["seconds"]["texture"], 0);
  const Outcome error = run("mesh-error " + text("wall.glb") + " --json --data " + text("out"));
  ASSERT_EQ(error.code, 0) << error.err;
  EXPECT_GT(Json::parse(error.out)["pictures"]["covered"], 0.5);

  ASSERT_EQ(run(mesh("wall.obj", "--texture")).code, 0);
  EXPECT_THAT(read_bytes(path("wall.obj")), HasSubstr("mtllib wall.mtl\n"));
  EXPECT_THAT(read_bytes(path("wall.mtl")), HasSubstr("map_Kd wall.png\n"));
  EXPECT_EQ(read_photo(path("wall.png")).channels, 3);

  EXPECT_THAT(run(mesh("wall.stl", "--texture")).err,
              HasSubstr("needs a .glb, an .obj or a .usdz"));
  std::filesystem::remove(path("wall.obj"));
  const Outcome refused = run(mesh("wall.obj", "--texture"));
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("wall.png is there already"));
  ASSERT_EQ(run(mesh("wall.obj", "--texture --force")).code, 0);
  EXPECT_TRUE(std::filesystem::exists(path("wall.png.bak-1")));
}

TEST_F(MeshVerb, KeepsWhatIsThere) {
  make_wall();
  write_bytes(path("old.stl"), "old");
  const Outcome refused = run(mesh("old.stl"));
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("old.stl is there already"));
  ASSERT_EQ(run(mesh("old.stl", "--force")).code, 0);
  EXPECT_EQ(read_bytes(path("old.stl.bak-1")), "old");
}

TEST_F(MeshVerb, EndsWithOneLineAndARemedy) {
  make_wall();
  const auto expect = [&](const std::string& command, int code, const std::string& part) {
    const Outcome outcome = run(command + " -q");
    EXPECT_EQ(outcome.code, code) << command << "\n" << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  };
  expect("mesh " + text("wall.ply") + " -o " + text("a.glb"), 2, "give --cameras");
  expect(mesh("a.fbx"), 2, ".glb, .obj, .ply, .stl, .usda, .usdc or .usdz");
  expect(mesh("a.glb", "--voxel 0.001"), 2, "give --voxel");
  expect(mesh("a.glb", "--voxel 1000"), 3, "--voxel");
  GaussianModel one{Gaussians(1, host_memory()), 0, true, false};
  set_gaussian(one.gaussians, 0, {0, 0, 3}, 1e-3f, 0.1f);
  write_model(path("wall.ply"), one);
  expect(mesh("a.glb"), 3, "no pixel of 6 views shows a surface");
  one.gaussians.mean[0].x = std::numeric_limits<float>::quiet_NaN();
  write_model(path("wall.ply"), one);
  EXPECT_NE(run(mesh("a.glb")).code, 0);
  EXPECT_FALSE(std::filesystem::exists(path("a.glb")));
}

// A wall three units in front of all cameras, of which one has no map.
TEST_F(MeshVerb, FusesDepthMapsOfOtherPrograms) {
  write_scene(path("scene"));
  for (int v = 0; v + 1 < kViews; ++v)
    write_depth_png(path("maps/view_" + std::to_string(v) + ".png"),
                    ImageF(kWidth, kHeight, 1, 3000));
  const std::string command = "mesh " + text("scene") + " --depths " + text("maps");
  const Outcome outcome = run(command + " --json -o " + text("wall.ply"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(Json::parse(outcome.out)["views"], kViews - 1);
  write_bytes(path("truth.obj"), "v -2 -2 3\nv 2 -2 3\nv 2 2 3\nv -2 2 3\nf 1 2 3 4\n");
  const Outcome error =
      run("mesh-error " + text("wall.ply") + " " + text("truth.obj") + " --samples 1000 --json");
  EXPECT_LT(Json::parse(error.out)["accuracy"], 1e-3) << error.err;
  write_depth_png(path("none/view_0.png"), ImageF(kWidth, kHeight, 1, 0));
  EXPECT_THAT(run("mesh " + text("scene") + " --depths " + text("none")).err,
              HasSubstr("know nothing"));
  EXPECT_EQ(run("mesh " + text("scene") + " --depths " + text("nowhere")).code, 3);
}

// Near things decide the voxel, and what is a thousand times as far the box.
TEST_F(MeshVerb, RefusesVoxelsThatDoNotFitIntoMemory) {
  write_scene(path("scene"));
  ImageF depth(kWidth, kHeight, 1, 50);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth / 3; ++x) depth.at(x, y, 0) = 60000;
  for (int v = 0; v < kViews; ++v)
    write_depth_png(path("maps/view_" + std::to_string(v) + ".png"), depth);
  write_bytes(path("far.ply"), "older");
  const Outcome outcome = run("mesh " + text("scene") + " --depths " + text("maps") +
                              " --watertight --force -q -o " + text("far.ply"));
  EXPECT_EQ(outcome.code, 4) << outcome.err;
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("GiB are free; give --voxel"), HasSubstr("or crop")));
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  EXPECT_EQ(read_bytes(path("far.ply")), "older");
}

/// A model whose Gaussians are broken, or of which one is left, ends with a mesh or with one line.
TEST_F(MeshVerb, TakesModelsThatAreHardlyThere) {
  make_wall();
  const auto expect = [&](const GaussianModel& model, int code, const std::string& part,
                          const std::string& more = "") {
    write_model(path("wall.ply"), model);
    const Outcome outcome = run(mesh("a.glb", "-q --force " + more));
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_LE(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    std::filesystem::remove(path("a.glb"));
  };
  const auto model_of = [](const Vec3f& mean, float scale) {
    GaussianModel model{Gaussians(1, host_memory()), 0, true, false};
    set_gaussian(model.gaussians, 0, mean, scale, 0.99f);
    return model;
  };
  expect(model_of({0, 0, 3}, 0.3f), 0, "");
  const GaussianModel around = model_of({0.2f, 0, 0.3f}, 5);  // the cameras are inside of it
  expect(around, 0, "");
  expect(around, 3, "no pixel of 6 views shows a surface that another one shows, too", "--agreed");
  GaussianModel flat = model_of({0, 0, 3}, 0.3f);
  flat.gaussians.log_scale[0] = Vec3f(-200);  // without extent: its plane has no normal
  expect(flat, 3, "no pixel of 6 views shows a surface;");
  GaussianModel edge_on = model_of({0, 0, 3}, 0.3f);
  edge_on.gaussians.log_scale[0].x = -200;  // the cameras look along its plane
  expect(edge_on, 0, "");
}

TEST_F(MeshVerb, MakesASolidWithoutCameras) {
  GaussianModel ball{Gaussians(400, host_memory()), 0, true, false};
  for (std::size_t i = 0; i < 400; ++i) {
    const float y = 1 - (2 * float(i) + 1) / 400, turn = 2.39996323f * float(i);
    const float r = std::sqrt(1 - y * y);
    set_gaussian(ball.gaussians, i, {r * std::cos(turn), y, r * std::sin(turn)}, 0.12f, 0.95f);
  }
  write_model(path("ball.ply"), ball);
  const std::string command = "mesh " + text("ball.ply") + " --collision";
  const Outcome outcome = run(command + " --json --voxel 0.05 --decimate 500");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Json json = Json::parse(outcome.out);
  EXPECT_EQ(json["output"], text("ball-collision.glb"));
  EXPECT_EQ(json["views"], 0);
  EXPECT_EQ(json["pieces"], 1);
  EXPECT_LE(json["triangles"], 500);
  EXPECT_EQ(json["vertices"].get<int>() - json["triangles"].get<int>() / 2, 2);  // closed
  EXPECT_THAT(run(command + " floor --voxel 0.05 -o " + text("floor.stl")).out,
              HasSubstr("the model alone"));
  EXPECT_THAT(run(command + " --voxel 1e-5").err, HasSubstr("give --voxel"));
  EXPECT_THAT(run(command + " --watertight").err, HasSubstr("--watertight"));
}

TEST_F(MeshVerb, IsMeasuredAgainstAKnownSurface) {
  make_wall();
  ASSERT_EQ(run(mesh("wall-mesh.glb")).code, 0);
  write_bytes(path("truth.obj"), "v -2 -2 3\nv 2 -2 3\nv 2 2 3\nv -2 2 3\nf 1 2 3 4\n");
  const std::string command =
      "mesh-error " + text("wall-mesh.glb") + " " + text("truth.obj") + " --samples 5000";
  const Outcome outcome = run(command);
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("Chamfer distance"), HasSubstr("F1")));
  const Json json = Json::parse(run(command + " --json --threshold 0.01 0.05").out);
  EXPECT_LT(json["accuracy"], 0.02);
  EXPECT_GT(json["normal_consistency"], 0.9);
  ASSERT_EQ(json["within"].size(), 2u);
  EXPECT_GT(json["within"][1]["precision"], 0.95);
}

// Two walls of the color of all photos, or of another one.
TEST_F(MeshVerb, IsMeasuredInHeldOutPhotos) {
  ASSERT_EQ(train("out", "-q").code, 0);
  write_bytes(path("wall.obj"),
              "v -9 -9 3 .5 .5 .5\nv 9 -9 3 .5 .5 .5\nv 9 9 3 .5 .5 .5\n"
              "v -9 9 3 .5 .5 .5\nf 1 2 3 4\n");
  const std::string command = "mesh-error " + text("wall.obj");
  const Outcome outcome = run(command + " --data " + text("out"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("held-out photos:"), HasSubstr("100.0 %")));
  const Json of_run = Json::parse(run(command + " --json --data " + text("out")).out)["pictures"];
  const Json of_scene =
      Json::parse(run(command + " --json --test-every 3 --data " + text("scene")).out)["pictures"];
  EXPECT_EQ(of_run["psnr"], of_scene["psnr"]);
  EXPECT_EQ(of_run["views"], 2);
  EXPECT_GT(of_run["psnr"], 5);
  write_bytes(path("truth.obj"), "v -9 -9 3\nv 9 -9 3\nv 9 9 3\nv -9 9 3\nf 1 2 3 4\n");
  const Json both = Json::parse(
      run(command + " " + text("truth.obj") + " --samples 1000 --json --data " + text("out")).out);
  EXPECT_LT(both["chamfer"], 1e-5);
  EXPECT_EQ(both["pictures"]["views"], 2);
  const auto expect_refused = [&](const std::string& words, const std::string& part) {
    const Outcome refused = run("mesh-error " + words + " -q");
    EXPECT_EQ(refused.code, 2) << words;
    EXPECT_THAT(refused.err, HasSubstr(part));
  };
  expect_refused(text("wall.obj"), "give the photos with --data");
  write_bytes(path("point.obj"), "v 0 0 0\n");
  expect_refused(text("point.obj") + " --data " + text("out"), "holds points");
  expect_refused(text("wall.obj") + " --set dataset.eval=false --data " + text("scene"),
                 "holds no photo out");
}

TEST_F(MeshVerb, MeasuresNothingEmpty) {
  write_bytes(path("empty.obj"), "");
  write_bytes(path("line.obj"), "v 0 0 0\nv 1 0 0\nf 1 2 1\n");
  write_bytes(path("point.obj"), "v 0 0 0\n");
  const Outcome empty = run("mesh-error " + text("empty.obj") + " " + text("point.obj"));
  EXPECT_EQ(empty.code, 3);
  EXPECT_THAT(empty.err, HasSubstr("has no vertex; name a mesh"));
  const Outcome line = run("mesh-error " + text("point.obj") + " " + text("line.obj"));
  EXPECT_EQ(line.code, 3);
  EXPECT_THAT(line.err, HasSubstr("no area"));
}

}  // namespace
}  // namespace gs
