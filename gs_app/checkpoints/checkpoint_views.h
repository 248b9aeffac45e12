// SPDX-License-Identifier: Apache-2.0
// The sections "view_names", "views", "view_times" and "view_lenses" of a checkpoint.
#pragma once

#include <vector>

#include "gs_app/checkpoints/checkpoint_file.h"
#include "gs_core/system/files/checked_file.h"

namespace gs {

void write_views(CheckedWriter& file, const std::vector<ViewRecord>& views);
std::vector<ViewRecord> read_views(CheckedReader& file);

/// The times of the views are in a section of their own, which only models in space and time have.
void write_times(CheckedWriter& file, const std::vector<ViewRecord>& views);
void read_times(CheckedReader& file, std::vector<ViewRecord>& views);

/// The lenses of the views, in a section of their own, which is there if a view has a lens.
bool have_lenses(const std::vector<ViewRecord>& views);
void write_lenses(CheckedWriter& file, const std::vector<ViewRecord>& views);
void read_lenses(CheckedReader& file, std::vector<ViewRecord>& views);

/// Whether a camera can have the numbers of the view.
bool is_sound(const ViewRecord& view);

}  // namespace gs
