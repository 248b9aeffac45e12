// SPDX-License-Identifier: Apache-2.0
// Operations on whole models: what is kept, and that a picture from a camera that moves along stays
// as it is.
#include "gs_app/edit/edit_step.h"

#include <gmock/gmock.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "data_loaders/cameras/camera_file.h"
#include "gs_app/edit/edit_cameras.h"
#include "gs_app/edit/edit_picture.h"
#include "gs_app/export/export_model.h"
#include "gs_core/bake_filter.h"
#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/rotation.h"
#include "gs_model/edit/merge_models.h"
#include "gs_model/edit/places/polygon_file.h"
#include "tests/support/error_of.h"
#include "tests/support/models.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

const Vec3d kUtm{500'000, 5'400'000, 300};

class Edit : public ::testing::Test {
 protected:
  const Camera camera_ = random_camera(120, 80);
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();

  EditSession session(Gaussians gaussians, const Vec3d& world_offset = Vec3d(0.0)) {
    EditSession s;
    s.model.model = {std::move(gaussians), kMaxShDegree, true, false, world_offset};
    s.model.cameras = {{"view", camera_}};
    s.tools = {[this]() -> Backend& { return *backend_; }, {}, false};
    return s;
  }
  EditSession typical(const Vec3d& world_offset = Vec3d(0.0)) {
    return session(random_gaussians(kTypical, 300, camera_, 2), world_offset);
  }
  StepReport apply(EditSession& s, const std::string& name, const std::string& value = "",
                   const EditOptions& options = {}) {
    return apply_step(s, edit_step(name, value, options));
  }
  std::vector<float> picture(const EditSession& s) {
    RenderPass pass;
    backend_->renderer().forward(s.model.model.gaussians.span(), s.model.cameras.front().camera,
                                 settings_for(s.model, s.tools), pass);
    return pass.image.download();
  }
  // The share of numbers that differ by more than rounding: a fragment at 1/255 may come or go.
  static double share_that_differs(const std::vector<float>& a, const std::vector<float>& b) {
    std::size_t differ = 0;
    for (std::size_t i = 0; i < a.size(); ++i) differ += std::abs(a[i] - b[i]) > 2e-3f;
    return double(differ) / double(a.size());
  }
  // Where a row's mean lies in the frame of the photos.
  static Vec3d in_photos_frame(const EditModel& model, std::size_t i) {
    const Mat4d m = input_from(model);
    const Vec3d p(model.model.gaussians.mean[i]);
    Vec3d result;
    for (int k = 0; k < 3; ++k)
      result[k] = m.m[k][0] * p.x + m.m[k][1] * p.y + m.m[k][2] * p.z + m.m[k][3];
    return result;
  }
};

// --- Choosing

TEST_F(Edit, KeepAndDropAreComplements) {
  for (const char* what :
       {"opacity=0.3..", "size=..0.05", "box=-1,-1,-1,1,1,1", "sphere=0,0,0,1.5", "y=..0.2",
        "distance=..2.5", "seen=1..", "contribution=2..", "view=view"}) {
    EditSession kept = typical(), dropped = typical();
    const StepReport keep = apply(kept, "keep", what), drop = apply(dropped, "drop", what);
    EXPECT_EQ(keep.before, 300u);
    EXPECT_EQ(keep.after + drop.after, 300u) << what;
    EXPECT_GT(keep.after, 0u) << what;
    EXPECT_GT(drop.after, 0u) << what;
    EXPECT_EQ(keep.after, kept.model.model.gaussians.count());
  }
}

TEST_F(Edit, WhatIsKeptHasTheProperty) {
  EditSession s = typical();
  apply(s, "keep", "opacity=0.3..0.7");
  apply(s, "drop", "size=0.05..");
  for (std::size_t i = 0; i < s.model.model.gaussians.count(); ++i) {
    EXPECT_NEAR(sigmoid(s.model.model.gaussians.logit_opacity[i]), 0.5, 0.2);
    EXPECT_LT(sizes_of(s.model.model.gaussians)[i], 0.05f);
  }
}

TEST_F(Edit, PlacesAreInThePhotosCoordinates) {
  EditSession s = typical(kUtm);
  const StepReport report = apply(s, "keep", "box=499999,5399999,299,500001,5400001,301");
  EXPECT_GT(report.after, 0u);
  EXPECT_LT(report.after, 300u);
  for (const Vec3f& mean : s.model.model.gaussians.mean)
    for (int axis = 0; axis < 3; ++axis) EXPECT_LE(std::abs(mean[axis]), 1);
}

TEST_F(Edit, OperationsApplyInTheirOrder) {
  EditSession first = typical(), second = typical();
  apply(first, "keep", "sphere=0,0,0,2");
  apply(first, "move", "5,0,0");
  apply(second, "move", "5,0,0");
  const StepReport there = apply(second, "keep", "sphere=5,0,0,2");
  EXPECT_EQ(there.after, first.model.model.gaussians.count());
  EXPECT_LT(there.after, 300u);
  EXPECT_TRUE(same_bits(first.model.model.gaussians, second.model.model.gaussians));
}

TEST_F(Edit, WhatNoCameraSeesIsNotInTheFilmAndGoesUnseen) {
  EditSession s = session(joined(random_gaussians(kTypical, 200, camera_, 2),
                                 random_gaussians(kBehind, 100, camera_, 3)));
  const std::vector<float> before = picture(s);
  EXPECT_GE(apply(s, "drop", "seen=0").before - s.model.model.gaussians.count(), 90u);
  EXPECT_LT(share_that_differs(picture(s), before), 1e-3);
}

TEST_F(Edit, TestViewsDoNotCountAsSeen) {
  EditSession s = typical();
  s.model.cameras.front().is_test = true;
  EXPECT_EQ(apply(s, "keep", "seen=0").after, 300u);
}

TEST_F(Edit, InvalidRowsAreThoseThatAreNeverDrawn) {
  EditSession s = session(with_bad_numbers(random_gaussians(kTypical, 300, camera_, 2)));
  s.model.model.gaussians.rotation[100] = {0, 0, 0, 0};
  EXPECT_EQ(apply(s, "drop", "invalid").after, 292u);
}

TEST_F(Edit, A3dFilterCountsForSizeAndOpacity) {
  Gaussians filtered = with_filters(random_gaussians(kTypical, 300, camera_, 2), 5);
  Gaussians baked = copy_of(filtered);
  bake_filter(baked);
  EditSession a = session(std::move(filtered)), b = session(std::move(baked));
  for (const char* what : {"opacity=0.2..", "size=..0.06"})
    EXPECT_EQ(apply(a, "keep", what).after, apply(b, "keep", what).after);
  EXPECT_TRUE(a.model.model.gaussians.has_filter);
}

TEST_F(Edit, NothingLeftIsRefusedAndSaysWhereTheModelLies) {
  EditSession s = typical(kUtm);
  EXPECT_THAT(error_of([&] { apply(s, "keep", "sphere=0,0,0,1"); }),
              AllOf(HasSubstr("no Gaussian is left after --keep sphere=0,0,0,1"),
                    HasSubstr("the means lay between 5e+05")));
}

TEST_F(Edit, CamerasThatAreMissingAreNamed) {
  EditSession s = typical();
  s.model.cameras.clear();
  EXPECT_THAT(error_of([&] { apply(s, "keep", "seen=2.."); }),
              HasSubstr("--keep seen=2.. needs cameras; name a run's folder, or give --data"));
  s = typical();
  EXPECT_THAT(error_of([&] { apply(s, "keep", "view=vieww"); }),
              HasSubstr("there is no camera vieww; did you mean view?"));
}

TEST_F(Edit, WordsThatAreNotUnderstoodAreRefusedBeforeAnyWork) {
  const auto error = [](const char* name, const char* value) {
    return error_of([&] { edit_step(name, value, {}); });
  };
  EXPECT_THAT(error("keep", "opacty=0.1.."), HasSubstr("did you mean opacity?"));
  EXPECT_THAT(error("keep", "opacity"), HasSubstr("needs a value: opacity=LOW..HIGH"));
  EXPECT_THAT(error("keep", "opacity>0.1"), HasSubstr("needs a value: opacity=LOW..HIGH"));
  EXPECT_THAT(error("keep", "opacity=..abc"), HasSubstr("\"abc\" is no number"));
  EXPECT_THAT(error("keep", "opacity=2..1"), HasSubstr("\"2..1\" is no range"));
  EXPECT_THAT(error("keep", "opacity=.."), HasSubstr("is no range"));
  EXPECT_THAT(error("drop", "box=1,2,3"), HasSubstr("these are 3 numbers, and it takes 6"));
  EXPECT_THAT(error("drop", "sphere=0,0,0,-1"), HasSubstr("radius must be above 0"));
  EXPECT_THAT(error("drop", "invalid=3"), HasSubstr("has no value"));
  EXPECT_THAT(error("turn", "1,x,0"), HasSubstr("\"x\" is no number"));
  EXPECT_THAT(error("scale", "0"), HasSubstr("at least 1e-6"));
  EXPECT_THAT(error("up", "0,0,0"), HasSubstr("no direction"));
  EXPECT_THAT(error("sh-degree", "4"), HasSubstr("SH degrees are 0 to 3"));
  EXPECT_THAT(error("decimate", "1.5"), HasSubstr("neither a number of Gaussians"));
  EXPECT_THAT(error("decimate", "200%"), HasSubstr("nor a share"));
  EXPECT_THAT(error("melt", ""), HasSubstr("there is no operation melt"));
}

// --- Areas

TEST_F(Edit, APolygonLiesInThePlaneThatIsNamed) {
  const TempFolder folder;
  EditOptions options;
  for (const auto& [plane, axis] : {std::pair("xz", 0), std::pair("zx", 2), std::pair("yz", 1)}) {
    options.places.plane = polygon_plane(plane);
    EditSession s = typical();
    const double half = median_mean(s.model.model)[axis];
    write_bytes(folder.path() / "area.txt",
                fmt::format("# half of it\n-9, -9\n{0} -9\n{0}\t9\n-9,9\n", half));
    const StepReport report =
        apply(s, "keep", "polygon=" + (folder.path() / "area.txt").string(), options);
    EXPECT_NEAR(double(report.after), 150, 1);
    for (const Vec3f& mean : s.model.model.gaussians.mean) EXPECT_LE(mean[axis], half);
  }
  EXPECT_THAT(error_of([] { polygon_plane("xx"); }), HasSubstr("name two axes"));
}

TEST_F(Edit, ALassoHoldsWhatItsCameraShowsInsideOfTheLine) {
  const TempFolder folder;
  const auto left = [&](const std::string& line, const Vec3d& offset = Vec3d(0.0),
                        const std::string& name = "line") {
    write_cameras_json(folder.path() / "cameras.json", std::vector<NamedCamera>{{"view", camera_}});
    const std::string camera =
        SortedJson::parse(read_bytes(folder.path() / "cameras.json"))[0].dump();
    write_bytes(folder.path() / "l", R"({"format": "gemsplat lasso", "version": 1, "camera": )" +
                                         camera + ", \"" + name + "\": " + line + "}");
    EditSession s = typical(offset);
    return apply(s, "keep", "lasso=" + (folder.path() / "l").string()).after;
  };
  EditSession s = typical();
  const std::string whole = "[[0,0],[120,0],[120,80],[0,80]]";
  const std::size_t all = apply(s, "keep", "view=view").after;
  EXPECT_EQ(left(whole), all);
  EXPECT_EQ(left(whole, kUtm), all);
  const std::size_t a = left("[[0,0],[120,0],[120,80]]"), b = left("[[0,0],[120,80],[0,80]]");
  EXPECT_EQ(a + b, all);
  EXPECT_GT(a, 0u);
  EXPECT_GT(b, 0u);
  for (const char* bad : {"[[0,0],[1,1]]", "[[0],[1,1],[2,2]]", "7", "[[0,0],[1,1],[2,\"a\"]]"})
    EXPECT_THAT(error_of([&] { left(bad); }), HasSubstr("save the lasso in the viewer again"))
        << bad;

  // A brush: what is within its radius of a stroke, from one point on.
  const auto painted = [&](const std::string& strokes, const std::string& radius) {
    return left(radius + ", \"strokes\": " + strokes, Vec3d(0.0), "radius");
  };
  EXPECT_EQ(painted("[[[60,40]]]", "200"), all);
  const std::size_t top = painted("[[[-100,0],[300,0]]]", "40");
  const std::size_t bottom = painted("[[[-100,80],[300,80]]]", "40");
  EXPECT_EQ(top + bottom, all);  // 80 pixels, and no Gaussian at the line between
  EXPECT_GT(top, 0u);
  EXPECT_GT(bottom, 0u);
  EXPECT_EQ(painted("[[[-100,0],[300,0]],[[-100,80],[60,80],[300,80]]]", "40"), all);
  for (const auto& damaged :
       {std::pair{"[[[60,40]]]", "0"}, {"[[]]", "3"}, {"[7]", "3"}, {"7", "3"}})
    EXPECT_THAT(error_of([&] { painted(damaged.first, damaged.second); }),
                HasSubstr("save the lasso in the viewer again"))
        << damaged.first;
}

TEST_F(Edit, GeoJsonAndTextSayTheSameArea) {
  const TempFolder folder;
  write_bytes(folder.path() / "a.txt", "0 0\n1 0\n1 1\n\n3 3\n4 3\n4 4\n");
  write_bytes(folder.path() / "a.geojson",
              R"({"type":"FeatureCollection","features":[{"type":"Feature","geometry":
              {"type":"MultiPolygon","coordinates":[[[[0,0],[1,0],[1,1]]],[[[3,3],[4,3],[4,4]]]]}}]})");
  const Polygon text = read_polygon(folder.path() / "a.txt");
  EXPECT_EQ(text.rings(), read_polygon(folder.path() / "a.geojson").rings());
  EXPECT_EQ(text.rings().size(), 2u);
}

TEST_F(Edit, DamagedAreasAreNamedWithTheirLine) {
  const TempFolder folder;
  const auto error = [&](const char* text) {
    write_bytes(folder.path() / "a.txt", text);
    return error_of([&] { read_polygon(folder.path() / "a.txt"); });
  };
  EXPECT_THAT(error("0 0\n1 x\n"), AllOf(HasSubstr("a.txt"), HasSubstr("line 2 is no vertex")));
  EXPECT_THAT(error("0 0\n1\n"), HasSubstr("line 2 has one number"));
  EXPECT_THAT(error("0 0\n1 1\n"), HasSubstr("a ring has 2 vertices"));
  EXPECT_THAT(error("# none\n"), HasSubstr("it holds no polygon"));
  EXPECT_THAT(error("{\"type\":\"Polygon\"}"), HasSubstr("a.txt"));
}

TEST_F(Edit, AllOfAGaussianIsInsideWhereTheWholeCounts) {
  const TempFolder folder;
  write_bytes(folder.path() / "area.txt", "-1 -1\n1 -1\n1 1\n-1 1\n");
  EditOptions whole;
  whole.places.whole = true;
  for (const std::string what :
       {"x=-1..1", "box=-1,-1,-1,1,1,1", "sphere=0,0,0,1", "polygon=area.txt"}) {
    const std::string value =
        what.starts_with("polygon") ? "polygon=" + (folder.path() / "area.txt").string() : what;
    EditSession s = session(Gaussians(4, host_memory()));
    const Gaussians& g = s.model.model.gaussians;
    for (std::size_t i = 0; i < 4; ++i) set_gaussian(g, i, {0.5f, 0, 0}, 0.1f, 0.5f);
    g.log_scale[1].x = g.log_scale[2].y = std::log(0.3f);  // reach 0.9 along x, along y
    g.log_scale[2].x = std::log(0.02f);
    g.mean[3].x = 1.5f;
    EXPECT_EQ(apply(s, "keep", value).after, 3u) << what;
    EditSession kept = session(copy_of(s.model.model.gaussians));
    // The sphere is tested by the box around a Gaussian, and the third one reaches beyond.
    EXPECT_EQ(apply(kept, "keep", value, whole).after, what.starts_with("sphere") ? 1u : 2u)
        << what;
  }
}

// --- Moving

TEST_F(Edit, AMovedModelLooksTheSameFromACameraThatMovesAlong) {
  EditOptions options;
  options.about = {0.5, -1, 2};
  for (const auto& [name, value] :
       std::vector<std::pair<std::string, std::string>>{{"move", "3,-2,1"},
                                                        {"turn", "20,-30,70"},
                                                        {"scale", "2.5"},
                                                        {"up", "0.3,0.8,-0.4"},
                                                        {"recenter", ""},
                                                        {"straighten", ""}}) {
    EditSession s = typical();
    const std::vector<float> before = picture(s);
    const Vec3d mean(s.model.model.gaussians.mean[7]);
    apply(s, name, value, options);
    EXPECT_LT(share_that_differs(picture(s), before), 1e-3) << name;
    EXPECT_GT(length(Vec3d(s.model.model.gaussians.mean[7]) - mean), 0.1) << name;
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(in_photos_frame(s.model, 7)[k], mean[k], 1e-5) << name;
  }
}

// sizes of the 3D filter are lengths, too
TEST_F(Edit, AScaledModelWithA3dFilterLooksTheSame) {
  EditSession s = session(with_filters(random_gaussians(kTypical, 300, camera_, 2), 5));
  const std::vector<float> before = picture(s);
  apply(s, "scale", "10");
  EXPECT_LT(share_that_differs(picture(s), before), 1e-3);
}

TEST_F(Edit, TurnsAreAboutXThenYThenZAndAPointStaysInPlace) {
  EditSession s = session(random_gaussians(kTypical, 1, camera_, 2));
  s.model.model.gaussians.mean[0] = {1, 2, 3};
  EditOptions options;
  options.about = {1, 0, 0};
  apply(s, "turn", "90,0,90", options);  // (0 2 3) -> (0 -3 2) -> (3 0 2)
  const Vec3f turned = s.model.model.gaussians.mean[0];
  EXPECT_NEAR(turned.x, 4, 1e-5);
  EXPECT_NEAR(turned.y, 0, 1e-5);
  EXPECT_NEAR(turned.z, 2, 1e-5);
  apply(s, "scale", "3", options);
  EXPECT_NEAR(s.model.model.gaussians.mean[0].x, 10, 1e-5);
}

TEST_F(Edit, FarFromTheOriginNothingIsLost) {
  EditSession s = typical(kUtm);
  const Vec3d before = in_photos_frame(s.model, 7);
  EditOptions options;
  options.about = kUtm;
  apply(s, "turn", "0,40,0", options);
  EXPECT_NE(s.model.model.world_offset, Vec3d(0.0));
  EXPECT_LT(length(Vec3d(s.model.model.gaussians.mean[7])), 20);  // floats hold it
  EXPECT_NEAR(length(in_photos_frame(s.model, 7) - before), 0, 1e-5);
  apply(s, "recenter");
  EXPECT_EQ(s.model.model.world_offset, Vec3d(0.0));
  EXPECT_NEAR(length(in_photos_frame(s.model, 7) - before), 0, 1e-5);
}

TEST_F(Edit, TheFrameOfThePhotosIsRestored) {
  for (const Vec3d& offset : {Vec3d(0.0), kUtm}) {
    EditSession s = typical(offset);
    EditOptions options;
    options.about = offset;
    const Vec3d before = in_photos_frame(s.model, 7);
    const std::vector<float> picture_before = picture(s);
    for (const auto& [name, value] :
         {std::pair("turn", "10,20,30"), std::pair("scale", "3"), std::pair("move", "1,2,3")})
      apply(s, name, value, options);
    apply(s, "restore-frame");
    EXPECT_FALSE(s.model.input_from_model);
    EXPECT_NEAR(length(in_photos_frame(s.model, 7) - before), 0, 1e-5);
    EXPECT_LT(share_that_differs(picture(s), picture_before), 1e-3);
    EXPECT_EQ(apply(s, "restore-frame").note, "the model was not moved");
  }
}

TEST_F(Edit, StraightenMakesTheCamerasUpMinusYAndPutsTheFloorAtZero) {
  EditSession s = typical();
  s.model.cameras.clear();
  // Cameras on a circle around (1 2 3), level in a world whose up is `up`.
  const Vec3d up = unit(Vec3d(0.3, -0.8, 0.4)), x = unit(cross(up, Vec3d(1, 0, 0))),
              y = cross(up, x);
  for (int i = 0; i < 8; ++i) {
    const double angle = i * M_PI / 4;
    const Vec3d outward = std::cos(angle) * x + std::sin(angle) * y;
    const Vec3d forward = -outward, down = -up, right = cross(down, forward);
    const Vec3d center = Vec3d(1, 2, 3) + 4.0 * outward;
    Camera camera = camera_;
    camera.cam_from_world_rotation = {Vec3f(right), Vec3f(down), Vec3f(forward)};
    camera.cam_from_world_translation = -multiply(camera.cam_from_world_rotation, Vec3f(center));
    s.model.cameras.push_back({"c" + std::to_string(i), camera});
  }
  Gaussians& g = s.model.model.gaussians;
  Draws draws(8);
  for (std::size_t i = 0; i < g.count(); ++i)  // a floor 1.5 below the middle
    set_gaussian(g, i,
                 Vec3f(Vec3d(1, 2, 3) - 1.5 * up + double(draws.uniform(-3, 3)) * x +
                       double(draws.uniform(-3, 3)) * y),
                 0.1f, 0.9f);
  const StepReport report = apply(s, "straighten");
  EXPECT_THAT(report.note, HasSubstr("as the cameras say"));
  for (const Vec3f& mean : g.mean) EXPECT_NEAR(mean.y, 0, 1e-4);
  for (const EditCamera& camera : s.model.cameras) {
    EXPECT_NEAR(camera.camera.cam_from_world_rotation.row1.y, 1, 1e-5);  // down is +y
    EXPECT_NEAR(camera.camera.position().y, -1.5, 1e-4);
  }
}

TEST_F(Edit, StraightenRefusesCamerasThatDoNotSayWhichWayIsUp) {
  EditSession s = typical();
  s.model.cameras.clear();
  for (int i = 0; i < 8; ++i) {  // looks along z and is turned about it
    const float angle = float(i * M_PI / 4);
    Camera camera = camera_;
    camera.cam_from_world_rotation = {
        {std::cos(angle), -std::sin(angle), 0}, {std::sin(angle), std::cos(angle), 0}, {0, 0, 1}};
    camera.cam_from_world_translation = {float(i), 0, 0};
    s.model.cameras.push_back({"c" + std::to_string(i), camera});
  }
  const Vec3f before = s.model.model.gaussians.mean[7];
  EXPECT_THAT(error_of([&] { apply(s, "straighten"); }),
              AllOf(HasSubstr("which way is up"), HasSubstr("--up X,Y,Z")));
  EXPECT_EQ(s.model.model.gaussians.mean[7], before);
}

TEST_F(Edit, TransformsOfMatricesAreTheInverseOfMatricesOfTransforms) {
  const ModelTransform there = transform_about({1, 2, 3}, turn_by_degrees({10, 20, 30}), 2.5);
  const Mat4d matrix = matrix_of(there);
  const Mat4d again = matrix_of(transform_of(matrix));
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) EXPECT_NEAR(again.m[i][j], matrix.m[i][j], 1e-12);
  EXPECT_TRUE(transform_of(translation({0, 0, 0})).is_identity());
}

// --- Making less

TEST_F(Edit, DecimateLeavesTheNumberThatIsAskedFor) {
  EditOptions dropping;
  dropping.decimates_by_merging = false;
  for (const auto& [value, left] : {std::pair("40", 40u), std::pair("0.25", 75u),
                                    std::pair("10%", 30u), std::pair("5000", 300u)}) {
    EditSession merged = typical(), dropped = typical();
    EXPECT_EQ(apply(merged, "decimate", value).after, left);
    EXPECT_EQ(apply(dropped, "decimate", value, dropping).after, left);
  }
}

TEST_F(Edit, DecimateChangesThePictureLessWhereCamerasAreKnown) {
  for (const bool merges : {true, false}) {
    EditOptions options;
    options.decimates_by_merging = merges;
    const auto squared_error = [&](bool cameras) {
      EditSession s = session(joined(random_gaussians(kOffScreen, 200, camera_, 4),
                                     random_gaussians(kTypical, 200, camera_, 2)));
      const std::vector<float> before = picture(s);
      const std::vector<EditCamera> known = s.model.cameras;
      if (!cameras) s.model.cameras.clear();
      apply(s, "decimate", "0.5", options);
      s.model.cameras = known;
      const std::vector<float> after = picture(s);
      double sum = 0;
      for (std::size_t i = 0; i < before.size(); ++i)
        sum += double(after[i] - before[i]) * double(after[i] - before[i]);
      return sum;
    };
    // Without cameras merges go by size, which says a part of what cameras say.
    const double most = merges ? 0.9 : 0.7;
    EXPECT_LT(squared_error(true), most * squared_error(false)) << "merges: " << merges;
  }
}

TEST_F(Edit, ALowerShDegreeMakesTheFileSmallerAndAHigherOneIsRefused) {
  const TempFolder folder;
  EditSession s = typical();
  export_model(s.model.model, {folder.path() / "full.ply"});
  apply(s, "sh-degree", "1");
  export_model(s.model.model, {folder.path() / "low.ply"});
  EXPECT_LT(std::filesystem::file_size(folder.path() / "low.ply"),
            0.5 * double(std::filesystem::file_size(folder.path() / "full.ply")));
  EXPECT_THAT(error_of([&] { apply(s, "sh-degree", "2"); }), HasSubstr("has SH degree 1"));
}

// --- Files

TEST_F(Edit, TheSidecarLeadsBackThroughSeveralEdits) {
  const TempFolder folder;
  for (const char* ending : {".ply", ".glb"})
    for (const Vec3d& offset : {Vec3d(0.0), kUtm}) {
      EditSession s = typical(offset);
      s.model.model.antialiased = true;
      const Vec3d before = in_photos_frame(s.model, 7);
      EditOptions options;
      options.about = offset;
      const std::filesystem::path first = folder.path() / (std::string("first") + ending),
                                  second = folder.path() / (std::string("second") + ending);
      apply(s, "turn", "10,20,30", options);
      ExportRequest request{first};
      request.input_from_model = s.model.input_from_model;
      export_model(s.model.model, request);
      s.model = model_to_edit(open_model(first, {}));
      EXPECT_NEAR(length(in_photos_frame(s.model, 7) - before), 0, 1e-3) << ending << offset.x;
      EXPECT_TRUE(s.model.model.antialiased);
      apply(s, "move", "1,2,3");
      request = {second};
      request.input_from_model = s.model.input_from_model;
      export_model(s.model.model, request);
      s.model = model_to_edit(open_model(second, {}));
      EXPECT_NEAR(length(in_photos_frame(s.model, 7) - before), 0, 1e-3) << ending << offset.x;
      for (const auto& file : {first, second, sidecar_of(first), sidecar_of(second)})
        std::filesystem::remove(file);
    }
}

// A mere shift could be taken for a world offset, and would then be undone.
TEST_F(Edit, AMoveIsThereAfterReadingAgain) {
  const TempFolder folder;
  EditSession s = typical();
  const Vec3d before(s.model.model.gaussians.mean[7]);
  apply(s, "move", "5,0,0");
  ExportRequest request{folder.path() / "moved.ply"};
  request.input_from_model = s.model.input_from_model;
  export_model(s.model.model, request);
  const OpenedModel again = open_model(folder.path() / "moved.ply", {});
  EXPECT_EQ(again.model.world_offset, Vec3d(0.0));
  EXPECT_NEAR(again.model.gaussians.mean[7].x, before.x + 5, 1e-5);
  ASSERT_TRUE(again.input_from_model);
  EXPECT_NEAR(again.input_from_model->m[0][3], -5, 1e-9);
}

TEST_F(Edit, ASidecarWhoseMatrixIsNoTurnIsIgnored) {
  const TempFolder folder;
  const std::filesystem::path file = folder.path() / "a.ply";
  export_model(typical().model.model, {file});
  for (const char* row : {"[0,0,0,0]", "[1,1,0,0]", "[-1,0,0,0]"}) {
    write_bytes(sidecar_of(file), fmt::format(R"({{"antialiased": true, "input_from_file":
        [{},[0,1,0,0],[0,0,1,0],[0,0,0,1]]}})",
                                              row));
    const OpenedModel opened = open_model(file, {});
    EXPECT_FALSE(opened.input_from_model) << row;
    EXPECT_FALSE(opened.model.antialiased) << row;
  }
}

TEST_F(Edit, CamerasOfAFileFitAModelThatWasMovedBefore) {
  const TempFolder folder;
  write_cameras_json(folder.path() / "cameras.json", {{"view", camera_}});
  EditSession s = typical();
  const std::vector<float> before = picture(s);
  apply(s, "turn", "10,20,30");
  apply(s, "scale", "2");
  s.model.cameras = cameras_to_edit(folder.path() / "cameras.json", s.model);
  ASSERT_EQ(s.model.cameras.size(), 1u);
  EXPECT_LT(share_that_differs(picture(s), before), 1e-3);
}

// --- Merging

TEST_F(Edit, MergedModelsStandInTheFrameOfTheFirst) {
  EditSession a = typical(), b = session(random_gaussians(kTypical, 200, camera_, 9));
  const std::vector<float> together =
      picture(session(joined(a.model.model.gaussians, b.model.model.gaussians)));
  apply(a, "turn", "10,20,30");
  apply(b, "scale", "3");
  apply(b, "move", "0,1,0");
  EditSession both = session(Gaussians(host_memory()));
  const Camera camera = a.model.cameras.front().camera;
  std::vector<NamedModel> models;
  models.push_back({"a.ply", std::move(a.model)});
  models.push_back({"b.ply", std::move(b.model)});
  both.model = merge_models(std::move(models));
  EXPECT_EQ(both.model.model.gaussians.count(), 500u);
  EXPECT_EQ(both.model.cameras.size(), 2u);
  both.model.cameras.front().camera = camera;
  EXPECT_LT(share_that_differs(picture(both), together), 1e-3);
}

TEST_F(Edit, DifferentOffsetsMeetInDoublePrecision) {
  EditModel a = std::move(typical(kUtm).model);
  EditModel b = std::move(typical(kUtm + Vec3d(1000, 0, 0)).model);
  const Vec3d first = in_photos_frame(a, 7), second = in_photos_frame(b, 7);
  std::vector<NamedModel> models;
  models.push_back({"a.ply", std::move(a)});
  models.push_back({"b.ply", std::move(b)});
  const EditModel both = merge_models(std::move(models));
  EXPECT_NEAR(length(in_photos_frame(both, 7) - first), 0, 1e-4);
  EXPECT_NEAR(length(in_photos_frame(both, 307) - second), 0, 1e-4);
  EXPECT_FALSE(both.input_from_model);
}

TEST_F(Edit, AsStoredIgnoresWhatTheSidecarsSay) {
  EditModel a = std::move(typical().model), b = std::move(typical().model);
  transform_edited(b, {{1, 2, 3}, {1, 0, 0, 0}, 1});
  const Vec3f moved = b.model.gaussians.mean[7];
  std::vector<NamedModel> models;
  models.push_back({"a.ply", std::move(a)});
  models.push_back({"b.ply", std::move(b)});
  const EditModel both = merge_models(std::move(models), {true, {}});
  EXPECT_EQ(both.model.gaussians.mean[307], moved);
}

TEST_F(Edit, TheHighestShDegreeHoldsForAll) {
  EditModel a = std::move(typical().model), b = std::move(typical().model);
  limit_sh_degree(a.model, 1);
  std::vector<NamedModel> models;
  models.push_back({"a.ply", std::move(a)});
  models.push_back({"b.ply", std::move(b)});
  const EditModel both = merge_models(std::move(models));
  EXPECT_EQ(both.model.sh_degree, 3);
  EXPECT_EQ(both.model.gaussians.sh_rest[7].coefficient[9], Vec3f(0));
}

TEST_F(Edit, ModelsThatCannotBeOneAreRefusedWithARemedy) {
  const auto refusal = [&](GaussianModel other, const MergeOptions& options = {}) {
    std::vector<NamedModel> models;
    models.push_back({"a.ply", std::move(typical().model)});
    models.push_back({"b.ply", {std::move(other), {}, {}}});
    return error_of([&] { merge_models(std::move(models), options); });
  };
  const auto plain = [&] { return random_gaussians(kTypical, 10, camera_, 2); };
  EXPECT_THAT(refusal({in_spacetime(plain(), 3), 3}),
              AllOf(HasSubstr("b.ply holds Gaussians in space and time, and a.ply 3D Gaussians"),
                    HasSubstr("gemsplat edit b.ply --time 0.5")));
  EXPECT_THAT(refusal({with_filters(plain(), 3), 3}), HasSubstr("gemsplat export b.ply plain.glb"));
  EXPECT_THAT(refusal({plain(), 3, true, true}), HasSubstr("--antialiased yes"));
}

// --- Space and time

TEST_F(Edit, GaussiansInSpaceAndTimeAreChosenByTheirLives) {
  EditSession s = session(in_spacetime(random_gaussians(kTypical, 300, camera_, 2), 4));
  s.model.model.gaussians.log_time_scale[0] = -4;  // a short life ...
  s.model.model.gaussians.time_mean[0] = 0.1f;     // ... at the begin
  EXPECT_EQ(apply(s, "drop", "time=0.95..").before, 300u);
  EXPECT_GT(s.model.model.gaussians.count(), 0u);
  EXPECT_EQ(s.model.model.gaussians.time_mean[0], 0.1f);
  EXPECT_GT(apply(s, "keep", "opacity=0.2..").after, 0u);
  EXPECT_GT(apply(s, "keep", "size=..10").after, 0u);
  apply(s, "turn", "0,90,0");
  EXPECT_TRUE(s.model.model.gaussians.has_time);
}

TEST_F(Edit, WhatHasNoMeaningInSpaceAndTimeIsRefused) {
  const auto error = [&](const char* name, const char* value) {
    EditSession s = session(in_spacetime(random_gaussians(kTypical, 30, camera_, 2), 4));
    return error_of([&] { apply(s, name, value); });
  };
  EXPECT_THAT(error("decimate", "0.5"), HasSubstr("--time"));
  EXPECT_THAT(error("decimate", "5000"), HasSubstr("--time"));
  EXPECT_THAT(error("scale", "2"), HasSubstr("--time"));
  EditSession still = typical();
  EXPECT_THAT(error_of([&] { apply(still, "keep", "time=0..0.5"); }), HasSubstr("3D Gaussians"));
  EXPECT_THAT(error_of([&] { apply(still, "time", "0.5"); }), HasSubstr("no time"));
}

TEST_F(Edit, AMomentIsA3dModelThatLooksTheSameThen) {
  EditSession s = session(in_spacetime(random_gaussians(kTypical, 300, camera_, 2), 4));
  s.model.cameras.front().camera.time = 0.4f;
  const std::vector<float> before = picture(s);
  apply(s, "time", "0.4");
  EXPECT_FALSE(s.model.model.gaussians.has_time);
  EXPECT_LT(share_that_differs(picture(s), before), 1e-2);
  apply(s, "scale", "2");
  EXPECT_LT(share_that_differs(picture(s), before), 1e-2);
}

// --- Pictures

TEST_F(Edit, ThePictureShowsBeforeAndAfter) {
  EditSession s = typical();
  const EditPicture picture(s.model, s.tools, "view");
  const Image8 same = picture.beside(s.model);
  EXPECT_EQ(same.width, 120 + 4 + 120);
  EXPECT_EQ(same.height, 80);
  apply(s, "keep", "opacity=0.8..");
  const Image8 other = picture.beside(s.model);
  int changed_left = 0, changed_right = 0;
  for (int y = 0; y < 80; ++y)
    for (int x = 0; x < 120; ++x) {
      EXPECT_EQ(same.at(x, y, 0), same.at(124 + x, y, 0));
      changed_left += same.at(x, y, 0) != other.at(x, y, 0);
      changed_right += same.at(124 + x, y, 0) != other.at(124 + x, y, 0);
    }
  EXPECT_EQ(changed_left, 0);
  EXPECT_GT(changed_right, 1000);
}

TEST_F(Edit, TheCameraOutsideSeesNineInTenMeans) {
  const EditSession s = typical(kUtm);
  const Camera camera = camera_before(s.model.model);
  int seen = 0;
  for (const Vec3f& mean : s.model.model.gaussians.mean) seen += is_in_picture(camera, mean);
  EXPECT_GE(seen, 270);
}

}  // namespace
}  // namespace gs
