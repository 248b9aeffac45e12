// SPDX-License-Identifier: Apache-2.0
// What the readers of foreign/*.cpp share.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/photos/photos.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// A lens with the polynomials of Brown; pixels.
struct BrownLens {
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0, p1 = 0, p2 = 0;  // k4 is of r^8; p1 and p2 are OpenCV's
};

/// A model that grows photo by photo. All functions throw Error that names the file.
class ForeignModel {
 public:
  ForeignModel(std::filesystem::path file, std::filesystem::path photos);

  /// The photo that a label means: its path, the end of its path, or that without its ending. Nothing
  /// if there is none, of which take() warns. Throws Error if several photos could be meant.
  std::optional<std::string> photo(const std::string& label);
  /// The one photo whose path ends in this, with or without its ending; nothing if none or several do.
  std::optional<std::string> photo_at(const std::string& end) const;
  PhotoSize size_of(const std::string& photo) const;

  /// Cameras with equal values are one. Returns its id.
  std::uint32_t camera(CameraModel model, PhotoSize size, std::vector<double> params);
  std::uint32_t camera(PhotoSize size, const BrownLens& lens);

  /// Adds a photo by the rows of its rotation and its translation, from world to camera; or by the
  /// columns of axes of the camera in the world and its center. The camera looks along z with y
  /// down; `looks_back`: along -z with y up, as in OpenGL.
  void add(const std::string& photo, std::uint32_t camera, const Mat3<double>& cam_from_world,
           const Vec3d& translation, bool looks_back = false);
  void add_at(const std::string& photo, std::uint32_t camera, const Mat3<double>& world_from_cam,
              const Vec3d& center, bool looks_back = false);
  /// A color of the file: 0 to 255. A point that is not finite is left out.
  void add_point(const Vec3d& position, const Vec3d& color);

  /// The whole model. Throws Error if no photo was found.
  ColmapModel take();

  const std::filesystem::path& file() const { return file_; }
  const std::filesystem::path& photos() const { return photos_; }
  [[noreturn]] void fail(const std::string& what) const;

 private:
  std::filesystem::path file_, photos_;
  std::map<std::string, std::vector<std::string>> names_;  // by their ends, in lower case
  std::map<std::tuple<int, int, int, std::vector<double>>, std::uint32_t> cameras_;
  std::map<std::string, std::size_t> added_;  // photos
  std::vector<std::string> missing_;          // labels
  ColmapModel model_;
};

/// Values of a JSON file, which some programs write as text. Throws Error that names the key.
class ForeignJson {
 public:
  explicit ForeignJson(const ForeignModel& model) : model_(model) {}

  /// The value of a key, which must be there.
  const SortedJson& at(const SortedJson& object, const char* key) const;
  /// The elements of a list or an object; none if the key is not there.
  const SortedJson& list(const SortedJson& object, const char* key) const;
  double number(const SortedJson& value, const char* key) const;
  double number_at(const SortedJson& object, const char* key) const;
  double number_or(const SortedJson& object, const char* key, double otherwise) const;
  PhotoSize size_at(const SortedJson& object, const char* width, const char* height) const;
  /// A list of `count` numbers.
  std::vector<double> numbers(const SortedJson& value, const char* key, std::size_t count) const;
  Vec3d vector_at(const SortedJson& object, const char* key) const;
  /// Text, or a number as text.
  std::string text_at(const SortedJson& object, const char* key) const;

 private:
  const ForeignModel& model_;
};

/// The matrix with these nine numbers by rows.
Mat3<double> matrix_of_rows(const std::vector<double>& numbers);
Mat3<double> transposed(const Mat3<double>& m);

// One reader for each form; the file is model.file().
void read_alicevision(ForeignModel& model);
void read_bundler(ForeignModel& model);
void read_metashape(ForeignModel& model);
void read_mvsnet(ForeignModel& model);
void read_opensfm(ForeignModel& model);
void read_openmvg(ForeignModel& model);
void read_polycam(ForeignModel& model);
void read_realityscan(ForeignModel& model);
void read_record3d(ForeignModel& model);

/// The photos that Bundler's list beside the file names; nothing if there is none.
std::optional<std::filesystem::path> bundler_list(const std::filesystem::path& file);

}  // namespace gs
