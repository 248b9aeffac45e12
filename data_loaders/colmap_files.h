// SPDX-License-Identifier: Apache-2.0
// What the binary and the text reader of COLMAP models share; used by colmap_*.cpp only.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "data_loaders/colmap_model.h"

namespace gs::colmap {

/// Throws Error: cannot read FILE in FOLDER: `what`; and what to try.
[[noreturn]] void fail(const std::filesystem::path& file, const std::string& what);

/// The model of a name as in cameras.txt.
std::optional<CameraModel> camera_model_of(std::string_view name);

/// Each puts one record into the model. Returns what is wrong with the record, "" if nothing: the
/// reader knows the place in the file.
std::string add_camera(ColmapModel& model, ColmapCamera camera, std::uint64_t width,
                       std::uint64_t height);
std::string add_image(ColmapModel& model, ColmapImage image);
std::string add_point(ColmapModel& model, const ColmapPoint& point);

/// Read one file of a model. Throw Error.
void read_binary_cameras(const std::filesystem::path& file, ColmapModel& model);
void read_binary_images(const std::filesystem::path& file, ColmapModel& model);
void read_binary_points(const std::filesystem::path& file, ColmapModel& model);
void read_text_cameras(const std::filesystem::path& file, ColmapModel& model);
void read_text_images(const std::filesystem::path& file, ColmapModel& model);
void read_text_points(const std::filesystem::path& file, ColmapModel& model);

}  // namespace gs::colmap
