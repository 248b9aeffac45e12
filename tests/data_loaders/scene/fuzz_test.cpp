// SPDX-License-Identifier: Apache-2.0
// Thousands of damaged files for the readers of scenes (tests/support/damage.h). The preset `debug`
// runs them under sanitizers.
#include <gtest/gtest.h>

#include "data_loaders/cameras/camera_file.h"
#include "data_loaders/georef/georef_file.h"
#include "data_loaders/georef/gps_places.h"
#include "data_loaders/lenses/undistort.h"
#include "data_loaders/scene/load_scene.h"
#include "data_loaders/transforms/transforms_json.h"
#include "gs_core/system/log.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/damage.h"
#include "tests/support/gps_photo.h"
#include "tests/support/tiny_photos.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// A file, and the function that reads it.
struct Target {
  fs::path file;
  void (*read)(const fs::path& scene);
};

template <std::size_t n>
std::string bytes_of(const unsigned char (&array)[n]) {
  return std::string(reinterpret_cast<const char*>(array), n);
}

/// One good file of each kind; in each case a damaged one replaces one of them.
class Corpus {
 public:
  Corpus() {
    ColmapModel model = small_model(4);
    model.cameras[8] = {8, CameraModel::opencv, 12, 8, {10, 11, 6.5, 3.5, 0.1, 0.01, 0, 0}};
    model.images[3].camera_id = 8;
    model.rigs.push_back(
        {1, {{7, true, {1, 0, 0, 0}, {0, 0, 0}}, {8, true, {1, 0, 0, 0}, {1, 0, 0}}}});
    model.frames.push_back({1, 1, {1, 2}});
    write_scene(path("binary"), model);
    write_scene(path("text"), model);
    fs::remove_all(path("text/sparse"));
    write_text_model(path("text/sparse/0"), model);
    for (const char* name : {"cameras", "images", "points3D", "rigs", "frames"}) {
      targets_.push_back({path("binary/sparse/0") / (std::string(name) + ".bin"), read_binary});
      targets_.push_back({path("text/sparse/0") / (std::string(name) + ".txt"), read_text});
    }
    write_bytes(
        path("transforms/transforms.json"),
        "{\"camera_model\": \"OPENCV\", \"fl_x\": 10.5, \"fl_y\": 11, \"cx\": 6, \"cy\": 4, \"w\": "
        "12, \"h\": 8, "
        "\"k1\": 0.1, \"ply_file_path\": \"points.ply\", \"frames\": [{\"file_path\": \"a.png\", "
        "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}, {\"file_path\": "
        "\"b.png\", \"fl_x\": 12, "
        "\"transform_matrix\": [[0,-1,0,2],[1,0,0,0.5],[0,0,1,-3e0],[0,0,0,1]]}]}");
    write_point_ply(path("transforms/points.ply"),
                    {{{1, 2, 3}, {4, 5, 6}}, {{0, 0, 1}, {255, 0, 1}}});
    const auto transforms = [](const fs::path& root) { read_transforms(root / "transforms"); };
    targets_.push_back({path("transforms/transforms.json"), transforms});
    targets_.push_back({path("transforms/points.ply"), transforms});
    GaussianModel gaussians{Gaussians(3, host_memory()), 1, false, false};
    for_each_array([](const char*, auto& array) { array.fill_zero(); }, gaussians.gaussians);
    for (std::size_t i = 0; i < 3; ++i) gaussians.gaussians.rotation[i] = {1, 0, 0, 0};
    write_gaussian_ply(path("trained.ply"), gaussians);
    targets_.push_back({path("trained.ply"),
                        [](const fs::path& root) { read_gaussian_ply(root / "trained.ply"); }});
    write_bytes(path("photo.jpg"), bytes_of(kTurnedJpeg));
    targets_.push_back({path("photo.jpg"), [](const fs::path& root) {
                          read_photo_size(root / "photo.jpg");
                          read_photo(root / "photo.jpg");
                        }});
    write_png(path("photo.png"), plain_photo(12, 8, 77));
    targets_.push_back({path("photo.png"), [](const fs::path& root) {
                          read_photo_size(root / "photo.png");
                          read_photo(root / "photo.png");
                        }});
    write_gps_photo(path("place.jpg"), 12, 8, {15.5, 48.2, 300});
    if (can_read_places()) {
      const auto place = [](const fs::path& root) { read_photo_place(root / "place.jpg"); };
      targets_.push_back({path("place.jpg"), place});
    }
    write_georef(path("georef.json"), {{{15.5, 48.2, 300}, {}}, "a test", "above the ellipsoid"});
    targets_.push_back(
        {path("georef.json"), [](const fs::path& root) { read_georef(root / "georef.json"); }});
    write_bytes(path("gps.txt"), "# places\na.jpg 48.2 15.5 300\nb c.jpg -33.1 +151.2 -2.5\n");
    targets_.push_back(
        {path("gps.txt"), [](const fs::path& root) { read_gps_file(root / "gps.txt"); }});
    for (const Target& target : targets_) originals_.push_back(read_bytes(target.file));
  }

  /// Reads every undamaged file, which must succeed.
  void read_all() const {
    for (const Target& target : targets_) target.read(temp_.path());
  }
  /// Damages one file, reads it, and restores it. Returns what went wrong, or nothing.
  std::string try_case(unsigned number) {
    std::mt19937 random(number);
    const std::size_t which = random() % targets_.size();
    const Target& target = targets_[which];
    replace_bytes(target.file, damaged(originals_[which], random));
    const std::string trouble = trouble_of([&] { target.read(temp_.path()); });
    replace_bytes(target.file, originals_[which]);
    return trouble.empty() ? "" : target.file.filename().string() + ": " + trouble;
  }

 private:
  bool can_read_places() const {
    try {
      return read_photo_place(path("place.jpg")).has_value();
    } catch (const Error&) {  // this build has no OpenImageIO
      return false;
    }
  }
  fs::path path(const std::string& name) const { return temp_.path() / name; }
  static void read_binary(const fs::path& root) { load(root / "binary"); }
  static void read_text(const fs::path& root) { load(root / "text"); }
  static void load(const fs::path& scene) {
    DatasetConfig dataset;
    dataset.source = scene.string();
    read_colmap_model(scene / "sparse/0");
    check_scene(dataset);
  }

  TempFolder temp_;
  std::vector<Target> targets_;
  std::vector<std::string> originals_;
};

TEST(Fuzz, DamagedFilesAreReadOrRefused) {
  setup_log(Verbosity::quiet);
  Corpus corpus;
  corpus.read_all();
  const FuzzCases cases;
  for (unsigned number = cases.first; number < cases.first + cases.count; ++number) {
    const std::string trouble = corpus.try_case(number);
    EXPECT_EQ(trouble, "") << "case " << number;
  }
}

}  // namespace
}  // namespace gs
