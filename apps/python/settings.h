// SPDX-License-Identifier: Apache-2.0
// Settings as Python gives them, over a Config.
#pragma once

#include <pybind11/pybind11.h>

#include <string>

#include "gs_core/config/config.h"

namespace gs::python {

/// True or False, of Python or of NumPy.
bool is_bool(const pybind11::handle& value);

/// Puts `settings` over `config`: None; the name of a preset, a TOML file or a run's folder; a dict, nested
/// ({"train": {"iterations": 100}}) or flat ({"train.iterations": 100}); or a list of these, the later over the earlier.
/// `section` (as "dataset.") stands before the keys of a dict. Throws UsageError that names the setting, and the nearest
/// that there is; does not check ranges (validate()).
void merge_settings(Config& config, const pybind11::handle& settings,
                    const std::string& section = {});

}  // namespace gs::python
