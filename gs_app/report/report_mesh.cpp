// SPDX-License-Identifier: Apache-2.0
#include "gs_app/report/report_mesh.h"

#include "data_loaders/photos/photos.h"
#include "gs_app/export/cameras.h"
#include "gs_app/pictures/pictures.h"
#include "gs_app/report/report_views.h"
#include "gs_app/run/model_mesh.h"
#include "gs_core/error.h"
#include "gs_core/evenly_chosen.h"
#include "gs_eval/mesh_pictures.h"
#include "gs_render/mesh/draw_mesh.h"
#include "gs_render/render_settings.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMeasuredViews = 8, kShownViews = 2;

/// Cameras of the run's views that have a photo in its folder, each with the photo.
std::vector<View> views_with_photos(const RunFolder& folder, int step, const Vec3d& offset) {
  const std::string split = split_names(folder, "test").empty() ? "train" : "test";
  const std::vector<std::string> names = names_of_pictures(folder, split);
  const std::vector<NamedCamera> cameras = cameras_of_run(folder, 1, split, offset);
  std::vector<View> views;
  for (const std::size_t i : evenly_chosen(names.size(), kMeasuredViews)) {
    const fs::path photo = folder.pictures(split, step) / "gt" / picture_file(i);
    const auto camera = std::find_if(cameras.begin(), cameras.end(), [&](const NamedCamera& named) {
      return fs::path(named.name).replace_extension() == fs::path(names[i]).replace_extension();
    });
    if (camera == cameras.end() || !fs::exists(photo)) continue;
    View view{names[i], camera->camera, read_photo(photo)};
    if (view.photo.width != view.camera.width || view.photo.height != view.camera.height) continue;
    views.push_back(std::move(view));
  }
  return views;
}

Json described(const fs::path& path, const RunFolder& folder, int step) {
  MeshOfFile file = read_mesh(path);
  decode_texture(file);
  const TriangleMesh& mesh = file.mesh;
  Config config;
  if (fs::exists(folder.config())) load_config(config, folder.config());
  const Vec3f background = render_settings(config).background;
  const std::vector<View> views = views_with_photos(folder, step, file.world_offset);
  const MeshPictures measured = compare_mesh_pictures(mesh, views, background);
  Json json = {{"name", path.filename().string()}, {"triangles", mesh.triangles.size()},
               {"vertices", mesh.vertices.size()}, {"texture", nullptr},
               {"pictures", Json::array()},        {"views", measured.views}};
  if (!mesh.texture.empty()) json["texture"] = {mesh.texture.width, mesh.texture.height};
  if (measured.views == 0) return json;
  json.update({{"psnr", measured.psnr}, {"ssim", measured.ssim}, {"covered", measured.covered}});
  for (const std::size_t i : evenly_chosen(views.size(), kShownViews))
    json["pictures"].push_back(
        {{"name", views[i].name},
         {"photo", page_picture(views[i].photo)},
         {"mesh", page_picture(to_image8(draw_mesh(mesh, views[i].camera, background).color))}});
  return json;
}

}  // namespace

Json report_mesh(const RunFolder& folder, int step, std::vector<std::string>& notes) {
  const fs::path path = mesh_beside(folder.root());
  if (path.empty()) return nullptr;
  try {
    return described(path, folder, step);
  } catch (const Error& error) {
    notes.push_back(error.what());
    return nullptr;
  }
}

}  // namespace gs
