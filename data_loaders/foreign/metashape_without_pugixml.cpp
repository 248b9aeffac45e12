// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/foreign/foreign_model.h"

namespace gs {

void read_metashape(ForeignModel& model) {
  model.fail(
      "this build reads no XML: build it with pugixml (Debian: libpugixml-dev), or export the "
      "cameras as COLMAP in Metashape 2.2 or later");
}

}  // namespace gs
