// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/refine/convert_cameras.h"

#include <spdlog/fmt/fmt.h>

#include <string>

#include "data_loaders/refine/refine_exposure.h"
#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// A photo of the camera, for messages.
std::string photo_of(const ColmapModel& model, std::uint32_t camera) {
  for (const ColmapImage& image : model.images)
    if (image.camera_id == camera) return image.name;
  return fmt::format("of camera {}", camera);
}

void check_fit(const ColmapCamera& camera, const FittedCamera& fit, double max_error) {
  const char* from = camera_model_info(camera.model).name;
  const char* to = camera_model_info(fit.camera.model).name;
  if (fit.unseen_share > 0)
    throw Error(
        fmt::format("camera {} ({}) cannot become {}: {:.1f} % of its picture shows places beside "
                    "or behind the camera; crop the photos, or train on the original model, which "
                    "gemsplat undistorts by itself",
                    camera.id, from, to, 100 * fit.unseen_share));
  if (!(fit.max_error <= max_error))
    throw Error(
        fmt::format("camera {} ({}) cannot become {}: its error would be {:.2f} pixels in the mean "
                    "and up to {:.2f}, but the limit is {}; give {}--max-error PIXELS, or train on "
                    "the original model, which gemsplat undistorts by itself",
                    camera.id, from, to, fit.mean_error, fit.max_error, max_error,
                    fit.camera.model == CameraModel::pinhole ? "--camera-model OPENCV or " : ""));
}

template <class T>
void append(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(T));
}

std::string binary_of(const std::vector<FittedCamera>& fits) {
  std::string bytes;
  append(bytes, std::uint64_t(fits.size()));
  for (const auto& [camera, mean, most, unseen] : fits) {
    append(bytes, camera.id);
    append(bytes, std::int32_t(camera.model));
    append(bytes, std::uint64_t(camera.width));
    append(bytes, std::uint64_t(camera.height));
    for (const double param : camera.params) append(bytes, param);
  }
  return bytes;
}

std::string text_of(const std::vector<FittedCamera>& fits) {
  std::string text =
      "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[], fitted by gemsplat convert-cameras\n";
  for (const auto& [camera, mean, most, unseen] : fits) {
    text += fmt::format("{} {} {} {}", camera.id, camera_model_info(camera.model).name,
                        camera.width, camera.height);
    for (const double param : camera.params) text += fmt::format(" {}", param);
    text += "\n";
  }
  return text;
}

}  // namespace

std::vector<FittedCamera> convert_cameras(const fs::path& from, const fs::path& to,
                                          CameraModel target, double max_error) {
  check_can_refine("convert-cameras");
  const OutputLock lock = OutputLock::of_new_folder(to);
  const ColmapModel model = read_colmap_model(from);
  std::vector<FittedCamera> fits;
  for (const auto& [id, camera] : model.cameras) {
    fits.push_back(fit_camera(camera, target, photo_of(model, id)));
    check_fit(camera, fits.back(), max_error);
  }
  const bool is_binary = fs::exists(from / "cameras.bin") && fs::exists(from / "images.bin");
  const std::string extension = is_binary ? ".bin" : ".txt";
  try {
    fs::create_directories(to);
    for (const char* stem : {"images", "points3D", "rigs", "frames"})
      if (fs::exists(from / (stem + extension)))
        fs::copy_file(from / (stem + extension), to / (stem + extension));
  } catch (const fs::filesystem_error& error) {
    throw Error(fmt::format(
        "cannot copy the model to {}: {}; free some space, or name another folder with -o",
        to.string(), error.code().message()));
  }
  AtomicFile file(to / ("cameras" + extension));  // last: without it the folder is no model
  file.write(is_binary ? binary_of(fits) : text_of(fits));
  file.commit();
  return fits;
}

}  // namespace gs
