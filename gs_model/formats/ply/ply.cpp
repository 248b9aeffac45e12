// SPDX-License-Identifier: Apache-2.0
// Reading trained Gaussians from PLY. Most of this file checks, before it asks for memory, whether
// the PLY holds Gaussians at all; ply_file.cpp reads the rows.
#include "gs_model/formats/ply/ply.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <optional>

#include "gs_core/bake_filter.h"
#include "gs_core/geometry/world_offset.h"
#include "gs_core/system/log.h"
#include "gs_model/formats/ply/compressed_ply.h"
#include "gs_model/formats/ply/mip_filter.h"
#include "gs_model/formats/ply/ply_file.h"
#include "gs_model/formats/ply/ply_layout.h"

namespace gs {
namespace {

template <class T>
void append_columns(std::vector<PlyColumn>& columns, const Buffer<T>& buffer,
                    std::initializer_list<const char*> names) {
  static_assert(sizeof(T) % sizeof(float) == 0);
  std::size_t offset = 0;
  for (const char* name : names) {
    columns.push_back({name, reinterpret_cast<float*>(buffer.data()), offset++, kNumbersOf<T>});
  }
}

/// Throws an Error that says what a file without the properties `missing` is, as far as its header
/// tells.
[[noreturn]] void fail_without(const std::vector<std::string>& missing, const PlyElement& vertex,
                               const PlyFile& file) {
  const PlyElement* face = file.header().find("face");
  if (face && face->count > 0 && vertex.find("opacity") < 0) {
    cannot_read(file.path(),
                "this is a mesh, not trained Gaussians; name a point_cloud.ply that a "
                "trainer wrote");
  }
  if (vertex.find("x") >= 0 && vertex.find("opacity") < 0 && vertex.find("rot_0") < 0) {
    cannot_read(file.path(),
                "this is a point cloud, not trained Gaussians; name a point_cloud.ply "
                "that a trainer wrote");
  }
  if (missing.size() == 1 && missing[0] == "scale_2") {
    cannot_read(file.path(),
                "these are 2D Gaussians (there is no scale_2), which gemsplat does not "
                "know; train 3D Gaussians on the same scene");
  }
  cannot_read(file.path(),
              fmt::format("its element \"vertex\" lacks {}; export the file again with "
                          "all properties of trained Gaussians",
                          list_of(missing)));
}

void check_properties(const PlyElement& vertex, const GaussianModel& model, const PlyFile& file) {
  std::vector<std::string> missing;
  for (const PlyColumn& column : gaussian_columns(model.gaussians, model.sh_degree)) {
    if (vertex.find(column.property) < 0) missing.push_back(column.property);
  }
  if (!missing.empty()) fail_without(missing, vertex, file);
}

bool is_ours(const PlyHeader& header) {
  return std::any_of(header.comments.begin(), header.comments.end(),
                     [](const std::string& comment) { return comment.starts_with("gemsplat "); });
}

/// "SplatRenderMode: mip" (Brush, gemsplat), "antialiased 1" or "postshot.anti_aliasing=1"
/// (Postshot); nothing where no comment speaks of it.
std::optional<bool> antialiased_comment(const PlyHeader& header) {
  constexpr const char* kSeparators = ":= ";
  for (const std::string& comment : header.comments) {
    const std::size_t key_end = comment.find_first_of(kSeparators);
    const std::size_t value = comment.find_first_not_of(kSeparators, key_end);
    if (value == comment.npos) continue;
    const std::string key = comment.substr(0, key_end), word = comment.substr(value);
    if (key == "SplatRenderMode") return word.starts_with("mip");
    if (key == "antialiased" || key == "postshot.anti_aliasing") return word.starts_with("1");
  }
  return std::nullopt;
}

GaussianModel read_plain_ply(PlyFile& file) {
  const PlyElement& vertex = *file.header().find("vertex");
  GaussianModel model;
  model.sh_degree = sh_degree_of(vertex, file.path());
  model.gaussians.has_time = vertex.find(kTimeMean) >= 0;
  check_properties(vertex, model, file);
  if (vertex.find(kOlderSlope) >= 0)
    log_warning(
        "{} has colors that change in time ({}), which this version does not draw; each Gaussian "
        "keeps the color of the middle of its life",
        file.path().string(), kOlderSlope);
  take_comments(file.header(), model);
  model.gaussians.has_filter = has_filter_3d(file.header());
  model.gaussians.resize(vertex.count);
  if (model.sh_degree < kMaxShDegree) model.gaussians.sh_rest.fill_zero();
  file.read_columns(vertex, gaussian_columns(model.gaussians, model.sh_degree));
  // Trainers with a 3D filter have an antialiased 2D one, too, unless a comment denies it.
  if (model.gaussians.has_filter)
    model.antialiased = antialiased_comment(file.header()).value_or(true);
  return model;
}

GaussianModel read_ply(PlyFile& file) {
  if (!file.header().find("vertex"))
    cannot_read(file.path(), "it has no element \"vertex\"; name a PLY of trained Gaussians");
  return is_compressed_ply(file.header()) ? read_compressed_ply(file) : read_plain_ply(file);
}

}  // namespace

std::string list_of(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list;
}

int sh_degree_of(const PlyElement& element, const std::filesystem::path& path) {
  int count = 0;
  for (const PlyProperty& property : element.properties)
    count += property.name.starts_with("f_rest_");
  const std::optional<int> degree = sh_degree_with(count / 3);
  if (degree && count % 3 == 0) return *degree;
  if (count == 3 * sh_rest_count(4)) {
    cannot_read(path,
                "SH degree 4 is not supported (it has 72 f_rest_ properties); train or "
                "export with degree 3 or less");
  }
  cannot_read(path, fmt::format("{} f_rest_ properties belong to no SH degree (0, 9, 24 or 45 "
                                "would); export the file again",
                                count));
}

void take_comments(const PlyHeader& header, GaussianModel& model) {
  model.antialiased = antialiased_comment(header).value_or(false);
  model.is_ours = is_ours(header);
  model.world_offset = offset_of_comments(header.comments);
}

std::vector<PlyColumn> gaussian_columns(const Gaussians& gaussians, int sh_degree) {
  std::vector<PlyColumn> columns;
  append_columns(columns, gaussians.mean, {"x", "y", "z"});
  append_columns(columns, gaussians.sh0, {"f_dc_0", "f_dc_1", "f_dc_2"});
  const int rest = sh_rest_count(sh_degree);
  for (int i = 0; i < 3 * rest; ++i) {
    const int channel = i / rest, coefficient = i % rest;
    columns.push_back({fmt::format("f_rest_{}", i),
                       reinterpret_cast<float*>(gaussians.sh_rest.data()),
                       std::size_t(3 * coefficient + channel), sizeof(ShRest) / sizeof(float)});
  }
  append_columns(columns, gaussians.logit_opacity, {"opacity"});
  append_columns(columns, gaussians.log_scale, {"scale_0", "scale_1", "scale_2"});
  append_columns(columns, gaussians.rotation, {kFirstOfRotation, "rot_1", "rot_2", "rot_3"});
  if (gaussians.has_filter) append_columns(columns, gaussians.filter_scale, {kFilter3dProperty});
  if (!gaussians.has_time) return columns;
  append_columns(columns, gaussians.right_rotation,
                 {kFirstOfRightRotation, "right_rot_1", "right_rot_2", "right_rot_3"});
  append_columns(columns, gaussians.time_mean, {kTimeMean});
  append_columns(columns, gaussians.log_time_scale, {"time_scale"});
  return columns;
}

GaussianModel read_gaussian_ply(const std::filesystem::path& path) {
  PlyFile file(path);
  GaussianModel model = read_ply(file);
  if (!model.gaussians.has_filter) return model;
  bake_filter(model.gaussians);
  log_info(
      "{}: its 3D filter (filter_3D, of Mip-Splatting) is applied to scales and opacities, and the "
      "model is read as {}",
      path.string(), model.antialiased ? "antialiased" : "not antialiased");
  return model;
}

GaussianModel read_raw_gaussian_ply(const std::filesystem::path& path) {
  PlyFile file(path);
  return read_ply(file);
}

}  // namespace gs
