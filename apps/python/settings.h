// SPDX-License-Identifier: Apache-2.0
// From settings in Python to a Config.
#pragma once

#include <pybind11/pybind11.h>

#include <string>

#include "gs_core/config/config.h"

namespace gs::python {

/// True or False, of Python or of NumPy.
bool is_bool(const pybind11::handle& value);

/// Applies `settings` to `config`. They are None; the name of a preset, a TOML file or a run's
/// folder; a dict, nested ({"train": {"iterations": 100}}) or flat ({"train.iterations": 100}); or
/// a list of these, the later over the earlier. `section` (as "dataset.") is put before the keys of
/// a dict. Throws UsageError that names an unknown setting and the nearest known one. Ranges are
/// left to validate().
void merge_settings(Config& config, const pybind11::handle& settings,
                    const std::string& section = {});

}  // namespace gs::python
