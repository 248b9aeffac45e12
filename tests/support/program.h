// SPDX-License-Identifier: Apache-2.0
// The built program as users run it, and a scene for it: six pictures of 40x32 pixels and a COLMAP
// model as text.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <string>

#include "data_loaders/photos/encode/encode_png.h"
#include "gs_core/math/random.h"
#include "gs_core/system/text/json.h"
#include "tests/support/temp_folder.h"

namespace gs {

inline constexpr int kWidth = 40, kHeight = 32;  // pixels; a focal length is 40 pixels
inline constexpr int kPoints = 150;
inline constexpr int kViews = 6;  // two of them are held out by --test-every 3
inline constexpr const char* kTrain =
    " --eval --test-every 3 --iterations 20 --device cpu --set train.log_every=5";

struct Outcome {
  int code;
  std::string out, err;
};

inline Vec3f point(int p) {
  const Vec4f u = Random{7, RandomStream::test}.uniform4(std::uint64_t(p));
  const float z = 3 + 2 * u.z;
  return {(u.x - 0.5f) * z, (u.y - 0.5f) * z * 0.8f, z};
}

/// Cameras on a line, looking along z at points between 3 and 5 world units away. With tracks,
/// every photo shows all points that project into it.
inline void write_scene(const std::filesystem::path& folder, bool with_tracks = false) {
  std::ostringstream images, points;
  for (int v = 0; v < kViews; ++v) {
    Image8 photo(kWidth, kHeight, 3);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        photo.at(x, y, 0) = std::uint8_t(128 + 100 * std::sin(0.3 * (x + v)));
        photo.at(x, y, 1) = std::uint8_t(128 + 100 * std::sin(0.25 * y));
        photo.at(x, y, 2) = std::uint8_t(200 - 3 * y);
      }
    const std::string name = "view_" + std::to_string(v) + ".png";
    write_png(folder / "images" / name, photo);
    images << v + 1 << " 1 0 0 0 " << -0.1 * v << " 0 0 1 " << name << "\n";
    for (int p = 0; with_tracks && p < kPoints; ++p) {
      const Vec3f at = point(p) - Vec3f(0.1f * float(v), 0, 0);
      const float x = 40 * at.x / at.z + 20, y = 40 * at.y / at.z + 16;
      if (x > 0 && x < kWidth && y > 0 && y < kHeight)
        images << x << ' ' << y << ' ' << p + 1 << ' ';
    }
    images << "\n";
  }
  for (int p = 0; p < kPoints; ++p)
    points << p + 1 << ' ' << point(p).x << ' ' << point(p).y << ' ' << point(p).z
           << " 120 130 140 0.5\n";
  write_bytes(folder / "sparse/0/cameras.txt", "1 PINHOLE 40 32 40 40 20 16\n");
  write_bytes(folder / "sparse/0/images.txt", images.str());
  write_bytes(folder / "sparse/0/points3D.txt", points.str());
}

/// Damages the pixels of every photo and leaves its header, which has the size, as it is.
inline void damage_photos(const std::filesystem::path& folder) {
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    std::string bytes = read_bytes(entry.path());
    std::fill(bytes.begin() + std::ptrdiff_t(bytes.size() / 2), bytes.end(), '\0');
    write_bytes(entry.path(), bytes);
  }
}

/// A test that runs the built `gemsplat` (GS_PROGRAM), in a folder of its own.
class Program : public ::testing::Test {
 protected:
  // `before` is text in front of the program: variables of the shell.
  Outcome run(const std::string& arguments, const std::string& before = "") {
    const std::filesystem::path out = path("stdout.txt"), err = path("stderr.txt");
    const std::string command =
        before + GS_PROGRAM + " " + arguments + " >" + out.string() + " 2>" + err.string();
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_bytes(out), read_bytes(err)};
  }
  // Trains a run in `name`; every test that needs one trains its own, in less than a second.
  Outcome train(const std::string& name, const std::string& more = "") {
    if (!std::filesystem::exists(path("scene"))) write_scene(path("scene"));
    return run("train " + text("scene") + " -o " + text(name) + kTrain + " " + more);
  }
  std::filesystem::path path(const std::string& name) const { return folder_.path() / name; }
  std::string text(const std::string& name) const { return path(name).string(); }
  SortedJson json(const std::string& name) const {
    return SortedJson::parse(read_bytes(path(name)));
  }

 private:
  TempFolder folder_;
};

}  // namespace gs
