// SPDX-License-Identifier: Apache-2.0
// What a method of density control does, as constants: one function in a file of its own for each
// method, which density.strategy names. docs/method/density.md explains the rules; gs_train/density
// carries them out. What a person changes, such as steps and thresholds, is a setting of [density]
// instead.
#pragma once

#include <string>
#include <string_view>

#include "gs_core/math/density/growth.h"

namespace gs {

/// The rules of a method. Without changes they are those of Kerbl et al. 2023. Steps are those of a
/// 30,000-step run, unless they say otherwise.
struct GrowthMethod {
  // Where Gaussians are moved and copied (Kheradmand et al. 2024), the other rules do not count.
  bool relocates = false;

  // Which may grow, besides density.gradient_threshold
  GrowthScore score = GrowthScore::gradient;
  int score_photos = 0;            // drawn at a refinement, if the score sums values of pixels
  float score_threshold = 0;       // of such sums: for each of these photos
  float mask_error = 0;            // of a photo's range of errors: pixels above it are in the mask
  bool absolute_gradient = false;  // gradients are sums of absolute values over pixels
  StatisticsWindow window = StatisticsWindow::refinement;
  int every_epochs = 0;  // at least so many epochs between refinements

  // How many of them, up to density.max_gaussians
  GrowthSelection select = GrowthSelection::top_k;
  GrowthCurve curve = GrowthCurve::none;
  float ramp_from = 1;    // times smaller than the photos: where the curve "ramp" begins
  float most_growth = 1;  // in one refinement, of the count

  // What they become
  float small_scale = 0.01f;  // of the extent: below it a Gaussian is cloned, above it split
  SplitRules split;

  // Every density.reset_opacity_every steps
  OpacityRule opacity{OpacityPolicy::reset, kResetOpacity, MomentClearing::opacity};

  // What else a method lowers and removes; 0: nothing
  float opacity_cap = 1;      // after each refinement
  bool prune_unseen = false;  // what was in no pixel for a whole epoch
  float recovery_prune = 0;   // share of the Gaussians, some steps after opacities are lowered
  int recovery_after = 0;     // steps of any run
  int recovery_until = 0;     // last such change of the opacities
  float soft_prune = 0;       // share of the Gaussians, while there are refinements
  float hard_prune = 0;       // the same afterwards
  int share_prune_from = 0;   // of both
  int share_prune_every = 1;
  int share_prune_until = 0;
  float late_prune_opacity = 0;  // after the last refinement

  // The learning rate of the means begins to fall when photos are no longer reduced.
  bool waits_for_whole_photos = false;

  bool prunes_shares() const { return soft_prune > 0 || hard_prune > 0; }
  /// True where the number of Gaussians rises to density.max_gaussians.
  bool rises_to_cap() const { return relocates || needs_budget(curve); }
  bool operator==(const GrowthMethod&) const = default;
};

/// The method that a word of density.strategy names. Throws a UsageError that lists the words.
const GrowthMethod& growth_method(std::string_view strategy);
/// The words of density.strategy: "absgs, adaptive, ...".
std::string_view growth_method_words();

/// A row of the table of methods, for those who visit all of them.
struct NamedMethod {
  const char* name;
  GrowthMethod method;
};
struct NamedMethods {
  const NamedMethod *first, *last;
  const NamedMethod* begin() const { return first; }
  const NamedMethod* end() const { return last; }
};
NamedMethods growth_methods();

/// The methods, one file each.
GrowthMethod absgs_method();          // absgs.cpp
GrowthMethod adaptive_method();       // adaptive.cpp
GrowthMethod dash_gaussian_method();  // dash_gaussian.cpp
GrowthMethod fastgs_method();         // fastgs.cpp
GrowthMethod default_method();        // growth.cpp
GrowthMethod improved_gs_method();    // improved_gs.cpp
GrowthMethod litegs_method();         // litegs.cpp
GrowthMethod mcmc_method();           // mcmc.cpp
GrowthMethod speedy_splat_method();   // speedy_splat.cpp
GrowthMethod taming_method();         // taming.cpp

}  // namespace gs
