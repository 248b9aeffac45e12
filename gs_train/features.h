// SPDX-License-Identifier: Apache-2.0
// What a backend can do, and the one check of what a run asks for.
#pragma once

#include <string>
#include <vector>

namespace gs {

struct Config;

struct Features {
  std::vector<std::string> losses;       // words of loss.kind
  std::vector<std::string> photometric;  // words of photometric.model
  // Other processes take the same steps of the same model. This one cannot go back or take other
  // steps than they do.
  bool is_shared = false;
  bool draws_by_pixel = true;    // render.order = "pixel"
  bool trains_surfaces = true;   // settings of surface
  bool repeats_surfaces = true;  // the same with train.deterministic
};

/// Throws UsageError where the config asks for what a backend does not have. `name` is that of its
/// device.
void check_supported(const Config& config, const Features& features, const std::string& name);

}  // namespace gs
