// SPDX-License-Identifier: Apache-2.0
// Stage 5 for surfaces: the losses of a picture's normals, of a map of normals and of a neighboring
// photo, and their gradient (math/surface_loss.h).
#include "gs_core/math/render/surface_loss.h"

#include <numeric>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

// Calls f(x, y) for each pixel, and returns the sum of what it returns: rows in parallel, then the
// rows' sums one after the other, so that any number of threads has the same bits.
template <class F>
double sum_over_rows(int width, int height, F&& f) {
  std::vector<double> rows(static_cast<std::size_t>(height));
  parallel_for(rows.size(), 4, [&](std::size_t y) {
    for (int x = 0; x < width; ++x) rows[y] += double(f(x, int(y)));
  });
  return std::accumulate(rows.begin(), rows.end(), 0.0);
}

GrayPhoto gray_photo(const View& view, std::vector<float>& gray) {
  const int width = view.photo.width, height = view.photo.height;
  const std::uint8_t* const mask = view.mask.empty() ? nullptr : view.mask.pixels.data();
  gray.resize(std::size_t(width) * height);
  parallel_for(gray.size(), 4096, [&](std::size_t i) {
    gray[i] = gray_of(view.photo.pixels.data() + 3 * i, mask ? mask + i : nullptr);
  });
  return {gray.data(), width, height};
}

}  // namespace

double compare_surface(const View& view, const View* neighbor, const SurfaceWeights& weights,
                       int patch_phase, const RenderPass& pass, SurfaceGradient& dL) {
  const HostStage stage("surface loss");
  const Camera& camera = view.camera;
  GS_CHECK(pass.surface_image.size() == std::size_t(camera.width) * camera.height &&
           view.photo.width == camera.width && view.photo.height == camera.height);
  const std::size_t pixels = pass.surface_image.size();
  dL.sums.resize_discard(pixels);
  dL.surfaces.resize(pixels);
  dL.inverse_depth.resize(pixels);
  SurfacePicture picture{camera, pass.surface_image.data(), dL.inverse_depth.data(),
                         gray_photo(view, dL.gray), weights_of_each(weights, camera)};
  if (!view.normals.empty()) picture.prior = {view.normals.pixels.data(), camera.width};
  const auto over_pixels = [&](auto&& f) { return sum_over_rows(camera.width, camera.height, f); };
  over_pixels([&](int x, int y) {
    const std::size_t i = picture.index(x, y);
    return dL.inverse_depth[i] = mean_inverse_depth(pass.surface_image[i], from_axis(camera, x, y));
  });
  double loss = over_pixels([&](int x, int y) {
    return picture.compare_normals(x, y, dL.surfaces[picture.index(x, y)]);
  });
  if (neighbor && weights.photo > 0) {
    picture.neighbor = seen_from(camera, neighbor->camera);
    picture.other = gray_photo(*neighbor, dL.other_gray);
    picture.phase = patch_phase;
    const int across = picture.patches_across();
    loss += sum_over_rows(across, picture.patches_down(), [&](int x, int y) {
      return picture.compare_photos(y * across + x, dL.surfaces.data());
    });
  }
  over_pixels([&](int x, int y) {
    dL.sums[picture.index(x, y)] = picture.gradient(x, y, dL.surfaces.data());
    return 0;
  });
  return loss;
}

}  // namespace gs
