// SPDX-License-Identifier: Apache-2.0
// The options of gemsplat export.
#include <spdlog/fmt/fmt.h>

#include "gs_app/jobs/export/export_job.h"

namespace gs {
namespace {

void visit_frame(ExportJob& job, OptionList& option) {
  option("--up", job.up,
         "up direction in the model's axes; the model is turned so that it becomes -y, which "
         "viewers show at the top [no turn]")
      .takes("X,Y,Z")
      .count(3, 3)
      .commas()
      .group("Frame");
  option("--recenter", job.recenter, "move the median of the means to the origin").group("Frame");
  option("--scale", job.scale, "scale the model by this factor [1]")
      .takes("FACTOR")
      .between(1e-6, 1e6)
      .group("Frame")
      .rare();
  option("--georef", job.georef,
         "where the scene stands on earth [georef.json of the run's scene or of --data]")
      .takes("FILE")
      .group("Frame")
      .rare();
}

void visit_formats(ExportJob& job, OptionList& option) {
  option("--title", job.title, "what a page (.html) is called [the name of the scene's folder]")
      .takes("TEXT");
  option("--spz-version", job.options.spz_version,
         "version of .spz files: 3, which Spark and splat-transform read, 2 for older readers, "
         "with coarser rotations, or 4, which fewer programs read [3]")
      .takes("VERSION")
      .one_of({"2", "3", "4"})
      .rare();
  option("--spz-sh-bits", job.options.spz_sh_bits,
         "bits of an SH coefficient in .spz files: 8 is the finest, and makes a larger file [5 at "
         "degree 1, 4 beyond it]")
      .takes("BITS")
      .between(1, 8)
      .rare();
  option("--duration", job.options.duration,
         "duration of a scene that moves, in seconds: .gs4d files say it to players [not known]")
      .takes("SECONDS")
      .between(0, 1e6)
      .rare();
  option("--tile-gaussians", job.tile_gaussians,
         fmt::format("Gaussians in a tile of a tileset at most [{}]", kTileGaussiansAtMost))
      .takes("N")
      .between(100, 1'000'000)
      .rare();
}

}  // namespace

void visit_options(ExportJob& job, OptionList& option) {
  option("model", job.model, "a model in any format that gemsplat reads, or a run's folder")
      .takes("MODEL|RUN")
      .required();
  option("output,-o,--output", job.outputs,
         "files to write, each with a FILE.transforms.json that describes it; the ending of a name "
         "chooses its format: " +
             format_names() +
             "; .html is a page that shows the model without a server; a name that ends in / is "
             "the folder of a 3D Tiles tileset, which needs a georeference [beside the model: "
             "MODEL.spz]")
      .takes("FILE");
  model_options(option, job.choice);
  time_option(option, job.time,
              "write this moment of Gaussians in space and time, 0 to 1, as 3D Gaussians");
  option("--table", job.table,
         "output is a folder: write every format into it, with a table of sizes and losses");
  option(
      "--megabytes", job.megabytes,
      "files have at most this many million bytes: Gaussians are merged, and upper degrees of SH "
      "left away, whichever looks more like the model on its test views [any size]")
      .takes("MB")
      .between(1e-3, 1e6);
  visit_formats(job, option);
  option("--force", job.force, "if a file exists, move it to FILE.bak-N first");
  visit_frame(job, option);
  option("--no-measure", job.unmeasured,
         "do not render pictures to measure the loss of lossy files");
  camera_options(option, "-d,--data,-s,--source-path");
  option.get("--resolution").rare();
  render_options(option, "highest SH degree in the files");
  option.get("--sh-degree").is_rare = false;
  general_options(option);
  option.get("--config").rare();
}

}  // namespace gs
