// SPDX-License-Identifier: Apache-2.0
// Several trained models become one.
#pragma once

#include <string>
#include <vector>

#include "gs_model/edit/edit_model.h"

namespace gs {

struct MergeOptions {
  // The numbers of the files count as they stand, and not as their sidecars place them.
  bool as_stored = false;
  // Whether the result is antialiased; empty: what all models agree about.
  std::optional<bool> antialiased = {};
};

/// A model and its name for messages: a file, or "model 2".
struct NamedModel {
  std::string name;
  EditModel model;
};

/// All Gaussians of all models, in the frame of the first one. Every model is brought there by way
/// of the photos' frame, which all are taken to share. SH degrees are padded with zeros. Cameras
/// are those of all models. `models` is not empty.
///
/// Throws UsageError that names two files and a remedy, where models cannot be one: in space and
/// time and not, with a 3D filter and without, antialiased and not.
EditModel merge_models(std::vector<NamedModel> models, const MergeOptions& options = {});

}  // namespace gs
