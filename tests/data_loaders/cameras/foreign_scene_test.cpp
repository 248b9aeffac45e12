// SPDX-License-Identifier: Apache-2.0
// Files of other programs: each is written from the same cameras by the program's own rules, as its
// documentation and its exports have them, and must lead each point to the same pixel.
#include "data_loaders/foreign/foreign_scene.h"

#include <gmock/gmock.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <numbers>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/reconstruct/foreign_cameras.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/text/json.h"
#include "tests/support/captured_log.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

constexpr int kWidth = 40, kHeight = 30;  // pixels
constexpr double kFocal = 36, kLongest = kWidth;
constexpr double kCenterX = 21, kCenterY = 14.5;
constexpr double kK1 = 0.03, kK2 = -0.01, kP1 = 0.002, kP2 = -0.001;
const char* const kNames[] = {"photo_1", "photo_2"};

using Rows = Mat3<double>;

/// A pose by its camera's axes in the world (x right, y down, z forward) and its center.
struct Pose {
  Rows cam_from_world;
  Vec3d center;
  Vec3d translation() const { return -multiply(cam_from_world, center); }
  /// Rows of the matrix whose columns are the axes; with OpenGL's axes y and z point the other way.
  std::vector<double> world_from_cam(bool looks_back) const {
    const double b = looks_back ? -1 : 1;
    const Rows& R = cam_from_world;
    return {R.row0.x,     b * R.row1.x, b * R.row2.x, R.row0.y,    b * R.row1.y,
            b * R.row2.y, R.row0.z,     b * R.row1.z, b * R.row2.z};
  }
};

Pose pose(int i) {
  const Quat<double> q =
      i == 0 ? Quat<double>{0.9, 0.1, -0.3, 0.2} : Quat<double>{0.7, -0.4, 0.2, 0.5};
  return {rotation_matrix(q), i == 0 ? Vec3d(0.4, -0.2, -3) : Vec3d(-1.5, 0.6, 2.5)};
}

std::vector<double> numbers_of(const Vec3d& v) { return {v.x, v.y, v.z}; }
std::vector<double> by_rows(const Rows& R) {
  return {R.row0.x, R.row0.y, R.row0.z, R.row1.x, R.row1.y, R.row1.z, R.row2.x, R.row2.y, R.row2.z};
}
std::vector<double> by_columns(const Rows& R) {
  return {R.row0.x, R.row1.x, R.row2.x, R.row0.y, R.row1.y, R.row2.y, R.row0.z, R.row1.z, R.row2.z};
}
std::string joined(const std::vector<double>& numbers, const char* between) {
  std::string text;
  for (const double number : numbers)
    text += (text.empty() ? "" : between) + fmt::format("{:.17g}", number);
  return text;
}

class ForeignScenes : public FolderTest {
 protected:
  void SetUp() override {
    FolderTest::SetUp();
    for (const char* name : kNames)
      write_png(path(fmt::format("images/{}.png", name)), plain_photo(kWidth, kHeight, 9));
  }
  void write(const std::string& name, const SortedJson& json) const {
    write_bytes(path(name), json.dump());
  }
  ColmapModel read() const {
    const auto found = find_foreign_scene(folder());
    if (!found) throw std::runtime_error("nothing was found");
    return read_foreign_scene(found->file, foreign_photos(folder(), "images"));
  }
  std::string error() const {
    return error_of([&] { read(); });
  }
  /// False where the build has no pugixml.
  bool reads_xml() const {
    try {
      read();
      return true;
    } catch (const Error& error) {
      return std::string(error.what()).find("libpugixml-dev") == std::string::npos;
    }
  }
  /// Both photos have their poses; camera parameters are those of the model.
  void expect_the_cameras(const char* program, CameraModel lens,
                          const std::vector<double>& params) {
    const auto found = find_foreign_scene(folder());
    ASSERT_TRUE(found);
    EXPECT_STREQ(found->program, program);
    EXPECT_FALSE(holds_only_photos(folder()));
    const ColmapModel model = read();
    ASSERT_THAT(model.images, SizeIs(2));
    for (const ColmapImage& image : model.images) {
      const int i = image.name == "photo_1.png" ? 0 : 1;
      EXPECT_EQ(image.name, fmt::format("{}.png", kNames[i]));
      const Pose expected = pose(i);
      for (const Vec3d& point : {Vec3d(0.0, 0.0, 0.0), Vec3d(1, 2, 3), Vec3d(-5, 4, 0.5)}) {
        const Vec3d got = multiply(rotation_matrix(image.cam_from_world_rotation), point) +
                          image.cam_from_world_translation;
        EXPECT_LT(length(got - (multiply(expected.cam_from_world, point) + expected.translation())),
                  1e-9);
      }
      const ColmapCamera& camera = model.cameras.at(image.camera_id);
      EXPECT_EQ(camera.model, lens);
      EXPECT_EQ(camera.width, kWidth);
      EXPECT_EQ(camera.height, kHeight);
      ASSERT_EQ(camera.params.size(), params.size());
      for (std::size_t k = 0; k < params.size(); ++k)
        EXPECT_NEAR(camera.params[k], params[k], 1e-9) << k;
    }
    EXPECT_THAT(model.cameras, SizeIs(1));
    points_ = model.points;
  }
  std::vector<ColmapPoint> points_;
};

const std::vector<double> kPinhole = {kFocal, kFocal, kCenterX, kCenterY};
const std::vector<double> kOpencv = {kFocal, kFocal, kCenterX, kCenterY, kK1, kK2, kP1, kP2};

std::string metashape(const std::string& transform_of_component, bool is_moved) {
  // world = 2 R x + t: the chunk's coordinates are those of the world, turned back and halved.
  const Rows turn = rotation_matrix(Quat<double>{0.8, 0.6, 0, 0});
  const Vec3d t(3, -1, 2);
  std::string cameras;
  for (int i = 0; i < 2; ++i) {
    std::vector<double> axes = pose(i).world_from_cam(false);
    Vec3d center = pose(i).center;
    if (is_moved) {
      const Rows A = {
          {axes[0], axes[1], axes[2]}, {axes[3], axes[4], axes[5]}, {axes[6], axes[7], axes[8]}};
      const auto column = [&](int k) {
        const Vec3d c = k == 0   ? Vec3d(A.row0.x, A.row1.x, A.row2.x)
                        : k == 1 ? Vec3d(A.row0.y, A.row1.y, A.row2.y)
                                 : Vec3d(A.row0.z, A.row1.z, A.row2.z);
        return multiply_transposed(turn, c);
      };
      const Vec3d x = column(0), y = column(1), z = column(2);
      axes = {x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z};
      center = 0.5 * multiply_transposed(turn, center - t);
    }
    cameras += fmt::format(
        R"(<group><camera id="{}" sensor_id="7" component_id="0" label="{}"><transform>{} {:.17g} {} {:.17g} {} {:.17g} 0 0 0 1</transform></camera></group>)",
        i, kNames[i], joined({axes[0], axes[1], axes[2]}, " "), center.x,
        joined({axes[3], axes[4], axes[5]}, " "), center.y,
        joined({axes[6], axes[7], axes[8]}, " "), center.z);
  }
  const std::string transform = is_moved
                                    ? fmt::format(
                                          "<transform><rotation>{}</rotation><translation>{}</"
                                          "translation><scale>2</scale></transform>",
                                          joined(by_rows(turn), " "), joined(numbers_of(t), " "))
                                    : "";
  return fmt::format(
      R"(<?xml version="1.0" encoding="UTF-8"?><document version="2.0.0"><chunk label="Chunk 1"><sensors>
<sensor id="3" label="unused" type="cylindrical"><resolution width="4" height="4"/></sensor>
<sensor id="7" label="Phone" type="frame"><resolution width="{}" height="{}"/>
<calibration type="frame" class="initial"><f>1</f></calibration>
<calibration type="frame" class="adjusted"><f>{}</f><cx>{}</cx><cy>{}</cy><k1>{}</k1><k2>{}</k2><p1>{}</p1><p2>{}</p2></calibration>
</sensor></sensors><components><component id="0">{}</component></components>
<cameras>{}<camera id="9" sensor_id="7" label="unplaced"/></cameras></chunk></document>)",
      kWidth, kHeight, kFocal, kCenterX - kWidth / 2.0, kCenterY - kHeight / 2.0, kK1, kK2, kP2,
      kP1, transform + transform_of_component, cameras);
}

TEST_F(ForeignScenes, Metashape) {
  for (const bool is_moved : {false, true}) {
    write_bytes(path("export/cameras.xml"), metashape("", is_moved));
    if (!reads_xml()) GTEST_SKIP() << "this build has no pugixml";
    expect_the_cameras("Metashape", CameraModel::opencv, kOpencv);
  }
  std::string skewed = metashape("", false);
  skewed.replace(skewed.find("<k1>"), 0, "<b2>1</b2>");
  write_bytes(path("export/cameras.xml"), skewed);  // moves the borders by 15/36 pixels
  expect_the_cameras("Metashape", CameraModel::opencv, kOpencv);
  skewed.replace(skewed.find("<b2>1"), 5, "<b2>3");
  write_bytes(path("export/cameras.xml"), skewed);
  EXPECT_THAT(error(), AllOf(HasSubstr("cameras.xml"), HasSubstr("'Phone' has a skew"),
                             HasSubstr("undistorted")));
  write_bytes(path("export/cameras.xml"), skewed.substr(0, 900));
  EXPECT_THAT(error(), HasSubstr("it is no XML at byte"));
  std::string old = metashape("", false);
  old.replace(old.find("<f>36</f>"), 9, "<fx>36</fx><fy>36</fy>");
  write_bytes(path("export/cameras.xml"), old);
  EXPECT_THAT(error(), AllOf(HasSubstr("no focal length f"), HasSubstr("PhotoScan 1.2")));
}

TEST_F(ForeignScenes, CamerasThatHangOnOthersInMetashapeAreNamed) {
  std::string rig = metashape("", false);
  rig.replace(rig.find("<camera id=\"9\""), 0,
              "<camera id=\"8\" master_id=\"0\" label=\"right_1\"/>");
  write_bytes(path("export/cameras.xml"), rig);
  if (!reads_xml()) GTEST_SKIP() << "this build has no pugixml";
  CapturedLog logged;
  expect_the_cameras("Metashape", CameraModel::opencv, kOpencv);
  EXPECT_THAT(logged.text(), AllOf(HasSubstr("1 photos of"), HasSubstr("'right_1'")));
}

TEST_F(ForeignScenes, RealityScan) {
  std::string csv = "\xef\xbb\xbf#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\r\n";
  for (int i = 0; i < 2; ++i) {
    const std::vector<double> m = pose(i).world_from_cam(true);
    constexpr double kDegree = std::numbers::pi / 180;
    csv += fmt::format("{}.PNG,{},{},{},{}\n", kNames[i], joined(numbers_of(pose(i).center), ","),
                       joined({std::atan2(m[1], m[4]) / kDegree, std::asin(m[7]) / kDegree,
                               std::atan2(-m[6], m[8]) / kDegree},
                              ","),
                       joined({36 * kFocal / kLongest, (kCenterX - kWidth / 2.0) / kLongest,
                               (kCenterY - kHeight / 2.0) / kLongest},
                              ","),
                       joined({kK1, kK2, 0, 0, kP1, kP2}, ","));
  }
  write_bytes(path("poses.csv"), csv);
  expect_the_cameras("RealityScan", CameraModel::opencv, kOpencv);
  write_bytes(path("poses.csv"), csv.substr(0, csv.size() - 30) + "\n");
  EXPECT_THAT(error(), HasSubstr("line 3 has no number for 'k2'"));
  write_bytes(path("poses.csv"), "#name,x,y,alt,heading\n");
  EXPECT_THAT(error(), HasSubstr("no column 'pitch'"));
}

SortedJson opensfm() {
  SortedJson part = {{"cameras",
                      {{"v2 phone 40 30 brown 0.9",
                        {{"projection_type", "brown"},
                         {"width", kWidth},
                         {"height", kHeight},
                         {"focal_x", kFocal / kLongest},
                         {"focal_y", kFocal / kLongest},
                         {"c_x", (kCenterX - kWidth / 2.0) / kLongest},
                         {"c_y", (kCenterY - kHeight / 2.0) / kLongest},
                         {"k1", kK1},
                         {"k2", kK2},
                         {"k3", 0.0},
                         {"p1", kP1},
                         {"p2", kP2}}}}}};
  for (int i = 0; i < 2; ++i) {
    const Rows R = pose(i).cam_from_world;
    const double angle = std::acos((R.row0.x + R.row1.y + R.row2.z - 1) / 2);
    const Vec3d axis = unit(Vec3d(R.row2.y - R.row1.z, R.row0.z - R.row2.x, R.row1.x - R.row0.y));
    part["shots"][fmt::format("{}.png", kNames[i])] = {
        {"rotation", numbers_of(angle * axis)},
        {"translation", numbers_of(pose(i).translation())},
        {"camera", "v2 phone 40 30 brown 0.9"}};
  }
  part["points"] = {{"12", {{"coordinates", {1.0, 2.0, 3.0}}, {"color", {10.0, 20.0, 255.0}}}}};
  return SortedJson::array(
      {{{"cameras", SortedJson::object()}, {"shots", SortedJson::object()}}, part});
}

TEST_F(ForeignScenes, OpenSfm) {
  write("opensfm/reconstruction.json", opensfm());
  expect_the_cameras("OpenSfM", CameraModel::opencv, kOpencv);
  ASSERT_THAT(points_, SizeIs(1));
  EXPECT_EQ(points_[0].position, Vec3d(1, 2, 3));
  EXPECT_EQ(points_[0].color, (std::array<std::uint8_t, 3>{10, 20, 255}));
  SortedJson other = opensfm();
  other[1]["cameras"]["v2 phone 40 30 brown 0.9"]["projection_type"] = "dual";
  write("opensfm/reconstruction.json", other);
  EXPECT_THAT(error(), AllOf(HasSubstr("no camera like its 'dual'"), HasSubstr("undistort")));
}

TEST_F(ForeignScenes, OpenMvg) {
  SortedJson file = {{"sfm_data_version", "0.3"}, {"root_path", "/elsewhere"}};
  file["intrinsics"] = {{{"key", 4},
                         {"value",
                          {{"polymorphic_id", 2147483649.0},
                           {"polymorphic_name", "pinhole_brown_t2"},
                           {"ptr_wrapper",
                            {{"id", 2147483660.0},
                             {"data",
                              {{"width", kWidth},
                               {"height", kHeight},
                               {"focal_length", kFocal},
                               {"principal_point", {kCenterX, kCenterY}},
                               {"disto_t2", {kK1, kK2, 0.0, kP1, kP2}}}}}}}}}};
  for (int i = 0; i < 2; ++i) {
    const std::vector<double> R = by_rows(pose(i).cam_from_world);
    file["views"].push_back({{"key", i},
                             {"value",
                              {{"ptr_wrapper",
                                {{"data",
                                  {{"filename", fmt::format("{}.png", kNames[i])},
                                   {"id_intrinsic", 4},
                                   {"id_pose", i + 10}}}}}}}});
    file["extrinsics"].push_back(
        {{"key", i + 10},
         {"value",
          {{"rotation", {{R[0], R[1], R[2]}, {R[3], R[4], R[5]}, {R[6], R[7], R[8]}}},
           {"center", numbers_of(pose(i).center)}}}});
  }
  file["views"].push_back(
      {{"key", 9},
       {"value",
        {{"ptr_wrapper",
          {{"data", {{"filename", "unplaced.png"}, {"id_intrinsic", 4}, {"id_pose", 99}}}}}}}});
  file["structure"] = {{{"key", 0}, {"value", {{"X", {1.0, 2.0, 3.0}}}}}};
  write("sfm_data.json", file);
  expect_the_cameras("OpenMVG", CameraModel::opencv, kOpencv);
  EXPECT_THAT(points_, SizeIs(1));
}

TEST_F(ForeignScenes, Meshroom) {
  for (const bool is_new : {false, true}) {
    const auto text = [](double value) { return fmt::format("{:.17g}", value); };
    SortedJson file = {{"version", {"1", "2", "0"}}, {"featuresFolders", SortedJson::array()}};
    SortedJson intrinsic = {
        {"intrinsicId", "5"},
        {"width", text(kWidth)},
        {"height", text(kHeight)},
        {"type", "brown"},
        {"distortionParams", {text(kK1), text(kK2), "0", text(kP1), text(kP2)}}};
    if (is_new) {
      intrinsic.update(
          {{"focalLength", text(kFocal * 6.4 / kWidth)},
           {"sensorWidth", "6.4"},
           {"principalPoint", {text(kCenterX - kWidth / 2.0), text(kCenterY - kHeight / 2.0)}}});
    } else {
      intrinsic.update(
          {{"pxFocalLength", text(kFocal)}, {"principalPoint", {text(kCenterX), text(kCenterY)}}});
    }
    file["intrinsics"] = SortedJson::array({intrinsic});
    for (int i = 0; i < 2; ++i) {
      SortedJson rotation, center;
      for (const double number : by_columns(pose(i).cam_from_world))
        rotation.push_back(text(number));
      for (const double number : numbers_of(pose(i).center)) center.push_back(text(number));
      file["views"].push_back({{"viewId", text(i)},
                               {"poseId", text(i)},
                               {"intrinsicId", "5"},
                               {"path", fmt::format("C:\\photos\\{}.png", kNames[i])}});
      file["poses"].push_back(
          {{"poseId", text(i)},
           {"pose", {{"transform", {{"rotation", rotation}, {"center", center}}}}}});
    }
    write("cameras.sfm", file);
    expect_the_cameras("Meshroom", CameraModel::opencv, kOpencv);
  }
}

TEST_F(ForeignScenes, Bundler) {
  std::string out = "# Bundle file v0.3\n3 1\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n";
  for (int i = 0; i < 2; ++i) {
    const std::vector<double> m = pose(i).world_from_cam(true);
    const Rows R = {{m[0], m[3], m[6]}, {m[1], m[4], m[7]}, {m[2], m[5], m[8]}};
    out += fmt::format("{} {} {}\n{}\n{}\n", kFocal, kK1, kK2, joined(by_rows(R), " "),
                       joined(numbers_of(-multiply(R, pose(i).center)), " "));
  }
  out += "1 2 3\n10 20 255\n2 0 7 1.5 2.5 1 8 3.5 4.5\n";
  write_bytes(path("bundle/bundle.out"), out);
  EXPECT_FALSE(find_foreign_scene(folder())) << "the list is missing";
  write_bytes(path("bundle/list.txt"),
              "images/unplaced.jpg\nimages/photo_1.png 0 532.1\nimages/photo_2.png\n");
  expect_the_cameras("Bundler", CameraModel::opencv,
                     {kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kK1, kK2, 0, 0});
  EXPECT_THAT(points_, SizeIs(1));
  write_bytes(path("bundle/bundle.out"), out.substr(0, 300));
  EXPECT_THAT(error(), HasSubstr("a number is missing at byte"));
  write_bytes(path("bundle/bundle.out"), "# Bundle file v0.3\n3 999999999\n");
  EXPECT_THAT(error(), HasSubstr("more than it has"));
}

TEST_F(ForeignScenes, Polycam) {
  for (int i = 0; i < 2; ++i) {
    const std::vector<double> m = pose(i).world_from_cam(true);
    SortedJson file = {{"fx", kFocal},      {"fy", kFocal},    {"cx", kCenterX},
                       {"cy", kCenterY},    {"width", kWidth}, {"height", kHeight},
                       {"blur_score", 90.0}};
    for (int k = 0; k < 9; ++k) file[fmt::format("t_{}{}", k / 3, k % 3)] = m[k];
    const std::vector<double> center = numbers_of(pose(i).center);
    for (int k = 0; k < 3; ++k) file[fmt::format("t_{}3", k)] = center[k];
    write(fmt::format("keyframes/cameras/{}.json", kNames[i]),
          {{"t_00", "of ARKit, before the correction"}});
    write(fmt::format("keyframes/corrected_cameras/{}.json", kNames[i]), file);
  }
  write("keyframes/corrected_cameras/lost.json", {{"t_00", 1}});  // its photo is not there
  {
    CapturedLog logged;
    expect_the_cameras("Polycam", CameraModel::pinhole, kPinhole);
    EXPECT_THAT(logged.text(), HasSubstr("1 poses of"));
  }
  // A whole export has depth maps of the same names, and photos without and with their distortion.
  std::filesystem::remove_all(path("images"));
  const auto names = [&] {
    const ColmapModel model = read();
    return std::vector{model.images.at(0).name, model.images.at(1).name};
  };
  for (const char* photo : kNames)
    for (const char* place : {"depth/{}.png", "confidence/{}.png", "images/{}.jpg"})
      write_png(path("keyframes/" + fmt::format(fmt::runtime(place), photo)),
                plain_photo(kWidth, kHeight, 9));
  EXPECT_THAT(names(), ElementsAre("keyframes/images/photo_1.jpg", "keyframes/images/photo_2.jpg"));
  for (const char* photo : kNames)
    write_png(path(fmt::format("keyframes/corrected_images/{}.jpg", photo)),
              plain_photo(kWidth, kHeight, 9));
  EXPECT_THAT(names(), ElementsAre("keyframes/corrected_images/photo_1.jpg",
                                   "keyframes/corrected_images/photo_2.jpg"));
}

TEST_F(ForeignScenes, Record3D) {
  std::filesystem::remove_all(path("images"));
  SortedJson poses;
  for (int i = 0; i < 2; ++i) {
    const std::vector<double> m = pose(i).world_from_cam(true);
    // The quaternion of a rotation matrix.
    const double w = std::sqrt(1 + m[0] + m[4] + m[8]) / 2;
    const Vec3d c = pose(i).center;
    poses.push_back({(m[7] - m[5]) / (4 * w), (m[2] - m[6]) / (4 * w), (m[3] - m[1]) / (4 * w), w,
                     c.x, c.y, c.z});
    write_png(path(fmt::format("rgbd/{}.png", i)), plain_photo(kWidth, kHeight, 9));
    write_bytes(path(fmt::format("depth/{}.exr", i)), "a depth map");
    write_png(path(fmt::format("confidence/{}.png", i)), plain_photo(4, 3, 9));
  }
  SortedJson file = {{"w", 2 * kWidth},
                     {"h", 2 * kHeight},
                     {"frameTimestamps", std::vector<double>(1000, 0.25)},
                     {"poses", poses}};
  const auto write_file =
      [&] {  // K is the last key in a file of the program, far from the first bytes
        std::string text = file.dump();
        text.back() = ',';
        write_bytes(path("metadata.json"),
                    text + fmt::format("\"K\": [{}, 0, 0, 0, {}, 0, {}, {}, 1]}}", 2 * kFocal,
                                       2 * kFocal, 2 * kCenterX, 2 * kCenterY));
      };
  write_file();
  const ColmapModel model = read();
  ASSERT_THAT(model.images, SizeIs(2));
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(model.images[i].name, fmt::format("rgbd/{}.png", i));
    EXPECT_LT(length(model.images[i].cam_from_world_translation - pose(i).translation()), 1e-9);
    EXPECT_THAT(model.cameras.at(1).params, testing::ElementsAreArray(kPinhole));
  }
  file["perFrameIntrinsicCoeffs"] = {{80.0, 82.0, 41.0, 29.0}, {84.0, 86.0, 43.0, 31.0}};
  write_file();
  const ColmapModel by_frame = read();
  EXPECT_THAT(by_frame.cameras.at(1).params, ElementsAre(40, 41, 20.5, 14.5));
  EXPECT_THAT(by_frame.cameras.at(2).params, ElementsAre(42, 43, 21.5, 15.5));
  write_png(path("rgbd/2.png"), plain_photo(kWidth, kHeight, 9));
  EXPECT_THAT(error(), HasSubstr("2 poses for 3 photos"));
  std::filesystem::remove_all(path("rgbd"));
  write_png(path("other/0.png"), plain_photo(kWidth, kHeight, 9));
  EXPECT_THAT(error(), AllOf(HasSubstr("have the number 0"), HasSubstr("confidence/0.png"),
                             HasSubstr("dataset.images")));
}

TEST_F(ForeignScenes, MvsNet) {
  for (int i = 0; i < 2; ++i) {
    const std::vector<double> R = by_rows(pose(i).cam_from_world);
    const Vec3d t = pose(i).translation();
    write_bytes(
        path(fmt::format("cams/{}_cam.txt", kNames[i])),
        fmt::format("extrinsic\n{} {:.17g}\n{} {:.17g}\n{} {:.17g}\n0.0 0.0 0.0 "
                    "1.0\n\nintrinsic\n{} 0 {}\n0 {} {}\n0 0 1\n\n425 2.5\n",
                    joined({R[0], R[1], R[2]}, " "), t.x, joined({R[3], R[4], R[5]}, " "), t.y,
                    joined({R[6], R[7], R[8]}, " "), t.z, kFocal, kCenterX, kFocal, kCenterY));
  }
  expect_the_cameras("MVSNet", CameraModel::pinhole, kPinhole);
  write_bytes(path("cams/photo_2_cam.txt"), "extrinsic\n1 0 0 0\nintrinsic\n");
  EXPECT_THAT(error(), HasSubstr("photo_2_cam.txt has not 16 numbers behind 'extrinsic'"));
}

TEST_F(ForeignScenes, AreScenesThatTrain) {
  write("reconstruction.json", opensfm());
  DatasetConfig dataset;
  dataset.source = folder().string();
  const Scene scene = load_scene(dataset);
  EXPECT_THAT(scene.train_views, SizeIs(2));
  EXPECT_THAT(scene.points, SizeIs(1));
  write("other/reconstruction.json", opensfm());  // as if after another run
  dataset.model = "other/reconstruction.json";
  EXPECT_THAT(load_scene(dataset).train_views, SizeIs(2));
  dataset.model = "images/photo_1.png";
  EXPECT_THAT(error_of([&] { load_scene(dataset); }), HasSubstr("dataset.model"));
}

TEST_F(ForeignScenes, PhotosAreMeantByTheEndOfTheirPath) {
  write_png(path("images/other/photo_1.png"), plain_photo(kWidth, kHeight, 9));
  write("reconstruction.json", opensfm());
  EXPECT_THAT(error(), AllOf(HasSubstr("'photo_1.png' could be"), HasSubstr("other/photo_1.png"),
                             HasSubstr("dataset.images")));
  std::filesystem::remove_all(path("images"));
  write_png(path("images/another.png"), plain_photo(kWidth, kHeight, 9));
  EXPECT_THAT(error(), AllOf(HasSubstr("none of its 2 photos, such as 'photo_1.png', is in"),
                             HasSubstr("images")));
}

TEST_F(ForeignScenes, PosesThatAreNoneAreRefused) {
  SortedJson file = opensfm();
  file[1]["shots"]["photo_1.png"]["translation"][0] = nullptr;
  write("reconstruction.json", file);
  EXPECT_THAT(error(), HasSubstr("'translation' is no number"));
  file = opensfm();
  file[1]["cameras"]["v2 phone 40 30 brown 0.9"]["width"] = -4;
  write("reconstruction.json", file);
  EXPECT_THAT(error(), HasSubstr("-4 x 30 pixels"));
  write_bytes(path("reconstruction.json"), "[{\"cameras\":");
  EXPECT_THAT(error(), HasSubstr("reconstruction.json"));
}

TEST_F(ForeignScenes, NothingElseIsTakenForOne) {
  write_bytes(path("notes.xml"), "<html>");
  write_bytes(path("list.csv"), "name,price\n");
  write_bytes(path("cameras/a.json"), "{}");
  write_bytes(path("images/photo_1.json"), "{\"t_0\": 1}");
  EXPECT_FALSE(find_foreign_scene(folder()));
  EXPECT_TRUE(holds_only_photos(folder()));
}

}  // namespace
}  // namespace gs
