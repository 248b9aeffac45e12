// SPDX-License-Identifier: Apache-2.0
// Which Gaussians a user means, in words: "box=-1,-1,0,1,1,4", "opacity=..0.05", "seen=3..".
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "gs_app/export/contributions.h"
#include "gs_core/scene.h"
#include "gs_model/edit/edit_model.h"
#include "gs_model/edit/places/places.h"
#include "gs_model/edit/select.h"
#include "gs_train/backend.h"

namespace gs {

/// What operations need beside the model, where they render.
struct EditTools {
  std::function<Backend&()> backend;  // called when something is rendered
  RenderSettings settings;            // of the model as it was read
  bool show_progress = false;
  // The photos' scene with this world offset; empty where nothing can give one. Throws UsageError.
  std::function<Scene&(const Vec3d& offset)> scene = {};
};

/// The settings to render a model that was edited: with its SH degree, and with planes that grew
/// with it.
RenderSettings settings_for(const EditModel& model, const EditTools& tools);

/// How the training cameras see the Gaussians. Renders all of them.
Contributions training_contributions(const EditModel& model, const EditTools& tools);
/// The same of at most 256 of them, evenly chosen, in pictures of at most 100,000 pixels: enough to
/// compare Gaussians with each other, and faster for a large model on a CPU.
/// Fewer pixels change little; fewer cameras do, because one sees what others do not.
Contributions sampled_contributions(const EditModel& model, const EditTools& tools);

/// The camera of this name, with or without the extension of a photo. Throws UsageError.
const EditCamera& camera_named(const EditModel& model, const std::string& name);

struct Selection {
  std::string text;            // as it was given
  bool needs_cameras = false;  // of the run or scene
  /// (N) 1 for each Gaussian that the words mean. Throws UsageError where the model has no such
  /// property.
  std::function<Marks(const EditModel&, const EditTools&)> marks;
};

/// Reads the words of a selection; files that they name are read at once. Throws UsageError that
/// names the words and lists what there is.
Selection selection_of(const std::string& text, const PlaceOptions& places = {});

/// A kind of selection, for help texts and pages: "sphere", "X,Y,Z,RADIUS", "...".
struct SelectionKind {
  std::string name, values, meaning;
};
std::vector<SelectionKind> selection_kinds();

}  // namespace gs
