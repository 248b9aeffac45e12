// SPDX-License-Identifier: Apache-2.0
// What photometric.model = "auto" chooses for a scene: whether its photos differ in light so much
// that gains are worth learning.
#pragma once

#include <optional>
#include <string>

#include "gs_core/scene.h"

namespace gs {

struct PhotometricChoice {
  bool has_gains = false;  // else no photometric model
  std::string why;         // one sentence without its period
};

/// Gains, if a point's colors differ much between photos and exposures explain a large part of it.
/// Where exposures are not known there is no model; `unknown_because` completes "..., because".
PhotometricChoice choose_photometric(const std::optional<ExposureSummary>& exposure,
                                     const std::string& unknown_because);

}  // namespace gs
