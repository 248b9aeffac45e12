// SPDX-License-Identifier: Apache-2.0
// Operations on a model as words: `gemsplat edit` gives its flags in the order in which they stand,
// such as "keep" with "box=-1,-1,-1,1,1,1".
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "gs_app/edit/selection.h"

namespace gs {

/// How operations are meant, for all of them.
struct EditOptions {
  Vec3d about{0.0, 0.0, 0.0};  // stays in place where the model is turned or scaled
  PlaceOptions places;
  bool decimates_by_merging = true;  // or by dropping what matters least
};

struct EditSession {
  EditModel model;
  EditTools tools;
};

struct EditStep {
  std::string text;            // as on the command line: "--keep opacity=0.1.."
  bool needs_cameras = false;  // it cannot be done without
  bool likes_cameras = false;  // it is done better with
  /// Returns what there is to say beside the number of Gaussians; mostly nothing.
  std::function<std::string(EditSession&)> apply;
};

/// A kind of operation, for help texts: "turn", "X,Y,Z", "...". Without values it is a flag.
struct EditStepKind {
  std::string name, values, meaning;
};
std::vector<EditStepKind> edit_step_kinds();

/// Reads an operation. Throws UsageError for words that it does not understand, before any work.
EditStep edit_step(const std::string& name, const std::string& value, const EditOptions& options);

/// What a step did.
struct StepReport {
  std::string text, note;
  std::size_t before = 0, after = 0;  // Gaussians
};
/// Applies a step. Throws UsageError where the model has no cameras and the step needs them, and
/// where no Gaussian would be left.
StepReport apply_step(EditSession& session, const EditStep& step);

/// A number of Gaussians, "20000", or a share of them, "0.25" or "25%".
struct Amount {
  double value;
  bool is_share;

  std::size_t of(std::size_t all) const;
};
Amount amount_of(const std::string& text, const std::string& what);

/// Drops the Gaussians that matter least until `count` are left: those with the smallest largest
/// contribution to a training view, or without cameras those with the smallest coverage
/// (coverages_of).
void decimate_by_dropping(EditSession& session, std::size_t count);

}  // namespace gs
