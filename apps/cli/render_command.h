// SPDX-License-Identifier: Apache-2.0
// What gemsplat render is asked for, and the verb itself.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/cli/options.h"
#include "gs_app/export/film_path.h"
#include "gs_app/export/render_output.h"

namespace gs {

struct PictureSize {
  int width = 0, height = 0;  // pixels
};

/// The command line, checked as far as it can be without the model.
struct RenderCommand : CommandLine {
  std::string model;
  std::optional<int> step;     // of a run: the model saved after it
  std::string cameras, split;  // empty: not said
  PathRequest path;
  std::string path_file;  // of key frames, where path.kind is kKeyFrames
  OutputRequest output;
  std::optional<PictureSize> size;
  std::optional<double> field_of_view;  // degrees across the width
  std::vector<float> depth_range;       // nearest, farthest, world units; empty: found
  std::string normal_space = "world";   // or "camera"
  std::string like;                     // a photo of the run, or "each"; empty: neutral colors
  std::vector<float> times;             // of all pictures, or of the first and the last; 0 to 1

  bool is_path() const { return !path.kind.empty(); }
  bool shows(Quantity quantity) const;
};

/// Renders it. Throws Error.
void render(const RenderCommand& command);

}  // namespace gs
