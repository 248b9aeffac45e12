// SPDX-License-Identifier: Apache-2.0
// The settings of adaptive density control, for tests whose figures belong to it.
#pragma once

#include "gs_core/config/config.h"

namespace gs {

/// The preset adaptive.
inline Config adaptive_config() {
  Config config;
  load_config(config, "adaptive");
  return config;
}

}  // namespace gs
