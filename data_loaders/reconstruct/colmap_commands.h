// SPDX-License-Identifier: Apache-2.0
// The command lines of COLMAP's programs.
#pragma once

#include <initializer_list>
#include <set>
#include <string>
#include <vector>

#include "data_loaders/reconstruct/colmap_plan.h"

namespace gs {

/// One command line. Options have other names in other versions of COLMAP: the constructor asks the
/// command's own help which of them it knows.
class ColmapCommand {
 public:
  ColmapCommand(const std::string& program, const std::string& command);

  void add(const std::string& option, const std::string& value);
  /// Adds the first of these names that the command knows; nothing if it knows none.
  void add_known(std::initializer_list<const char*> options, const std::string& value);
  const std::vector<std::string>& arguments() const { return arguments_; }

 private:
  std::vector<std::string> arguments_;
  std::set<std::string> known_;
};

/// Of the photos of one camera group. Writes their list into the work folder, too.
ColmapCommand feature_command(const ColmapPlan& plan, const std::vector<PhotoFile>& photos);
ColmapCommand match_command(const ColmapPlan& plan);
/// Groups features into the visual words by which Matching::retrieval finds photos that look alike.
ColmapCommand vocabulary_command(const ColmapPlan& plan);
/// The mapper or, where the poses are known, the point_triangulator, which needs the model of
/// known_model() in plan.files.known().
ColmapCommand model_command(const ColmapPlan& plan);
/// Finds focal lengths for global_model_command(), which needs them. Both are of COLMAP 4 and work
/// on plan.files.global_database(), a copy, since this one changes the matches.
ColmapCommand calibration_command(const ColmapPlan& plan);
/// Places all cameras at once.
ColmapCommand global_model_command(const ColmapPlan& plan);

inline constexpr const char* kGlobalMapper = "global_mapper";
/// Whether the program knows a command.
bool has_command(const ColmapPlan& plan, const std::string& command);
/// Whether the program was built with CUDA.
bool has_cuda(const ColmapPlan& plan);
/// Tells the database that the views in plan.files.rig() are those of a rig. COLMAP 3.12 and later.
ColmapCommand rig_command(const ColmapPlan& plan);
/// Adjusts a model so that its views keep their places on that rig. Before COLMAP 3.12.
ColmapCommand rig_adjustment_command(const ColmapPlan& plan, const std::filesystem::path& model,
                                     const std::filesystem::path& adjusted);

/// The known poses with the ids that COLMAP gave the photos, by its log, and without points.
ColmapModel known_model(const ColmapPlan& plan);

}  // namespace gs
