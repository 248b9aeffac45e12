// SPDX-License-Identifier: Apache-2.0
// The options of gemsplat edit.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <iterator>

#include "gs_app/jobs/edit/edit_job.h"

namespace gs {
namespace {

// Operations that --help leaves to --help-all.
constexpr const char* kRareOperations[] = {"up", "recenter", "restore-frame", "time"};

void visit_operations(EditJob& job, OptionList& option) {
  for (const EditStepKind& kind : edit_step_kinds()) {
    const bool is_rare = std::find(std::begin(kRareOperations), std::end(kRareOperations),
                                   kind.name) != std::end(kRareOperations);
    option.operation(kind.name, kind.values, job.operations, kind.meaning)
        .group("Operations, in the order in which they are given")
        .is_rare = is_rare;
  }
}

// What --keep and --drop take, for the end of the help.
std::vector<std::pair<std::string, std::string>> selections() {
  std::vector<std::pair<std::string, std::string>> rows;
  for (const SelectionKind& kind : selection_kinds())
    if (!kind.meaning.empty())
      rows.emplace_back(kind.values.empty() ? kind.name : kind.name + "=" + kind.values,
                        kind.meaning);
  return rows;
}

}  // namespace

void visit_options(EditJob& job, OptionList& option) {
  option("model", job.inputs,
         "models in any format that gemsplat reads, or runs' folders; several are merged first, in "
         "the frame of the first one; or the folder of a partition, whose trained blocks are "
         "merged")
      .takes("MODEL|RUN")
      .required();
  option("-o,--output", job.output,
         "file to write; its ending chooses the format: " + format_names() +
             " [beside the model: MODEL-edited, in its format; of several MODEL-merged]")
      .takes("FILE");
  model_options(option, job.choice);
  visit_operations(job, option);
  option("--about", job.about, "the point that --turn, --scale and --up leave where it is [0,0,0]")
      .takes("X,Y,Z")
      .rare();
  option("--plane", job.plane,
         "the two axes of the plane of polygons: xz is the floor of a straightened model, xy that "
         "of a map [xz]")
      .takes("AXES")
      .rare();
  option("--whole", job.whole,
         "a Gaussian is in a box, sphere, polygon or range of coordinates if all of it is, to "
         "three standard deviations [its mean counts]")
      .rare();
  option("--decimate-by", job.decimate_by,
         "merge: merge near and similar Gaussians; drop: drop those that contribute least to the "
         "training views [merge]")
      .takes("HOW")
      .one_of({"merge", "drop"})
      .rare();
  option("--run", job.block_runs,
         "of a partition: a block's run that was trained elsewhere than by its experiment; its "
         "settings name the block; may be repeated")
      .takes("RUN")
      .repeated()
      .rare();
  option("--as-stored", job.as_stored,
         "merge the numbers of the files as they stand, whatever their sidecars say of their "
         "frames")
      .rare();
  option("--antialiased", job.antialiased,
         "whether merged models are rendered antialiased, if they do not agree")
      .one_of({"yes", "no"})
      .rare();
  option("--cameras", job.cameras,
         "cameras.json, transforms.json or COLMAP model instead of the run's cameras")
      .takes("FILE")
      .rare();
  option("--picture", job.picture, "write a picture of the model before and after, side by side")
      .takes("FILE.png")
      .rare();
  option("--picture-view", job.picture_view,
         "the camera of that picture [one outside of the model]")
      .takes("NAME")
      .rare();
  option("--measure", job.measure,
         "print PSNR and SSIM of the held-out views before and after; with the photos of the run "
         "or of --data");
  option("--dry-run", job.dry_run,
         "print the number of Gaussians after each operation, and write no model");
  option("--force", job.force, "if a file exists, move it to FILE.bak-N first");
  camera_options(option, "-d,--data,-s,--source-path");
  option.get("--data").rare();
  option.get("--resolution").rare();
  general_options(option);
  option.get("--config").rare();
  option.get("--set").rare();
  option.footer_title = "What --keep and --drop take (ranges may lack an end: 0.1.. or ..0.1)";
  option.footer = selections();
}

}  // namespace gs
