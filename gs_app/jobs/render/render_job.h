// SPDX-License-Identifier: Apache-2.0
// What gemsplat render is asked for.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gs_app/export/film_path.h"
#include "gs_app/export/render_output.h"
#include "gs_app/jobs/parts/job.h"
#include "gs_app/jobs/parts/shared_options.h"

namespace gs {

inline constexpr const char* kLikeEach = "each";  // every picture as the photo of its own name

struct PictureSize {
  int width = 0, height = 0;  // pixels
};

struct RenderJob : JobSettings {
  std::string model, cameras, split;  // empty: not said
  ModelChoice choice;
  PathRequest path;
  OutputRequest output;
  std::string lens;                        // a word of kViewLenses; empty: those of the cameras
  std::optional<double> field_of_view;     // degrees across the width
  std::optional<double> across;            // the same of parallel rays, world units
  std::optional<double> meters_per_pixel;  // of an orthophoto
  std::string georef;                      // of it; empty: that of the scene
  std::vector<float> depth_range;          // nearest, farthest, world units; empty: found
  std::string normal_space = "world";      // or "camera"
  std::string like;          // a photo of the run, or kLikeEach; empty: neutral colors
  std::vector<float> times;  // of all pictures, or of the first and the last; 0 to 1
  // As options have them; checked() puts them into `path`, `output`, `path_file` and `size`.
  std::string output_path, size_words;
  std::vector<std::string> quantities = {"color"}, formats;
  std::vector<double> center;
  std::optional<double> seconds;
  std::optional<int> frames;
  std::string path_file;  // of key frames, where path.kind is kKeyFrames
  std::optional<PictureSize> size;

  bool is_path() const { return !path.kind.empty(); }
  bool is_panorama() const { return lens == "equirectangular"; }
  bool shows(Quantity quantity) const;
};

void visit_options(RenderJob& job, OptionList& option);

/// The request, checked as far as it can be without the model. Throws UsageError.
RenderJob checked(RenderJob job);

}  // namespace gs
