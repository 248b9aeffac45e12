// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/ply/mip_filter.h"

namespace gs {

bool has_filter_3d(const PlyHeader& header) {
  const PlyElement* vertex = header.find("vertex");
  return vertex && vertex->find(kFilter3dProperty) >= 0;
}

}  // namespace gs
