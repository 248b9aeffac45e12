// SPDX-License-Identifier: Apache-2.0
// gemsplat.export() and gemsplat.report(), and what Model.save() shares with export().
#pragma once

#include <pybind11/pybind11.h>

#include "gs_app/export/export_model.h"

namespace gs::python {

/// The arguments of Python as a request. Throws UsageError and Error as check_export() does.
ExportRequest export_request(const std::filesystem::path& path, bool replace, int spz_version,
                             int spz_sh_bits);

void bind_outputs(pybind11::module_& module);

}  // namespace gs::python
