// SPDX-License-Identifier: Apache-2.0
// From a folder with photos and cameras to the Scene that training starts from.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs {

/// Called after each photo, from one thread at a time, with `done` counting up to `total`.
using ProgressFn = std::function<void(std::size_t done, std::size_t total)>;

/// The stages of load_scene(): cameras are refined if asked for, then the headers of all photos are
/// read, then all photos are decoded if they fit into memory.
enum class LoadStage { refinement, headers, photos };
using LoadProgress = std::function<void(LoadStage stage, std::size_t done, std::size_t total)>;

/// as_they_fit: photos that fit into dataset.photo_ram_gib together are decoded at once; if they do
/// not fit, a PhotoPool decodes each one shortly before it is asked for. when_asked: no photo is
/// decoded before it is asked for, however many would fit; for programs that show a few of them.
enum class PhotoLoading { as_they_fit, when_asked };

/// What not every run wants to know.
struct SceneNeeds {
  bool exposure_stops = false;  // View::exposure_stops, from the photos' headers
  bool normal_maps = false;     // View::normals, where there are some
};

/// Finds the model and the photos, undistorts and resizes every photo to dataset.resolution, and
/// splits the views. With dataset.eval, every test_every-th view by name is a test view, beginning
/// with the first (test_views_of() has the rule for rigs). Every size and name is checked before
/// the first photo is decoded. With dataset.refine_cameras the cameras are refined first. Throws
/// Error that names the file and the remedy; UsageError for a resolution or a photo budget that
/// cannot work. Warns of a scene that moves, because it is trained as a static one. With
/// dataset.photo_list the scene has the photos of the list and the points that they show; its
/// split, refined cameras and exposures are those of the whole scene.
Scene load_scene(const DatasetConfig& dataset, const LoadProgress& progress = {},
                 PhotoLoading loading = PhotoLoading::as_they_fit, const SceneNeeds& needs = {});

/// Why load_scene() could not solve for the exposures of this scene, as the end of a sentence;
/// empty if it could. Reads the model, and no photo. Throws like load_scene().
std::string why_exposures_are_unknown(const DatasetConfig& dataset);

/// How much the photos of a scene differ in light. Decodes each photo and keeps none. Throws like
/// load_scene(); only where exposures can be solved for.
ExposureSummary measure_light(const DatasetConfig& dataset);

/// A scene without its pictures: all that is known before the first photo is decoded.
struct SceneOutline {
  std::vector<std::string> names;  // (views)   sorted
  std::vector<Camera> cameras;     // (views)
  std::vector<bool> is_test;       // (views)
  std::vector<ScenePoint> points;
  std::vector<std::vector<std::uint32_t>> shown;  // (views)   the points that each view shows
  Vec3d world_offset{0.0, 0.0, 0.0};              // as in Scene
};

/// The outline of the scene that load_scene() would load. Throws like it.
SceneOutline outline_scene(const DatasetConfig& dataset, const LoadProgress& progress = {});

struct DepthAgreement;  // depth/depth_kind_of.h

/// How the depth maps of a scene go with its sparse points. Reads some maps, and no photo. Throws
/// like load_scene().
DepthAgreement measure_depth_maps(const DatasetConfig& dataset);

/// All checks of load_scene() before it decodes the first photo, without refining cameras. Throws
/// like load_scene().
void check_scene(const DatasetConfig& dataset, const SceneNeeds& needs = {});

}  // namespace gs
