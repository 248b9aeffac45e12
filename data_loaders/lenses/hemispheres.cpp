// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/lenses/hemispheres.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "data_loaders/lenses/resample.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

using std::numbers::pi;

/// The ray of a direction in the frame of the half behind, and back: half a turn around y.
Vec3d turned_back(const Vec3d& p) { return {-p.x, p.y, -p.z}; }

constexpr int kBorder = 3;  // pixels that bicubic weights reach, and the rounding of positions

/// The panorama with a border of what lies beyond its seam and its poles, beginning at a column.
Image8 with_border(const Image8& panorama, int first_column) {
  const int width = panorama.width, height = panorama.height, channels = panorama.channels;
  Image8 result(width + 2 * kBorder, height + 2 * kBorder, channels);
  parallel_for(std::size_t(result.height), 16, [&](std::size_t row) {
    int y = int(row) - kBorder, turned = first_column - kBorder + 4 * width;
    if (y < 0 || y >= height) {  // over the pole
      y = std::clamp(y < 0 ? -1 - y : 2 * height - 1 - y, 0, height - 1);
      turned += width / 2;
    }
    for (int x = 0; x < result.width; ++x)
      std::copy_n(&panorama.at((x + turned) % width, y, 0), channels, &result.at(x, int(row), 0));
  });
  return result;
}

/// A picture of the camera's size; ray(x, y) is the direction that a pixel of it shows.
template <class Ray>
Image8 resampled(const Image8& panorama, int first_column, const PinholeCamera<double>& to,
                 const std::string& photo, const Ray& ray) {
  if (std::max(panorama.width, panorama.height) + 2 * kBorder > kLongestResampled)
    throw Error(
        fmt::format("cannot cut panorama '{}': {} takes at most {} pixels a side; make it "
                    "smaller",
                    photo, resampler_name(), kLongestResampled - 2 * kBorder));
  const Image8 source = with_border(panorama, first_column);
  Image8 result(to.width, to.height, panorama.channels);
  parallel_chunks(std::size_t(to.height), 16, [&](std::size_t begin, std::size_t end) {
    PhotoPositions positions(to.width, int(end - begin));
    std::size_t i = 0;
    for (std::size_t y = begin; y < end; ++y)
      for (int x = 0; x < to.width; ++x, ++i) {
        const Vec2d at =
            panorama_pixel(ray(x + 0.5, double(y) + 0.5), panorama.width, panorama.height);
        const double turned = at.x - first_column;
        positions.x[i] = float((turned < 0 ? turned + panorama.width : turned) + kBorder - 0.5);
        positions.y[i] = float(at.y + kBorder - 0.5);
      }
    resample(source, positions, &result.at(0, int(begin), 0));
  });
  return result;
}

}  // namespace

Vec2d panorama_pixel(const Vec3d& p, int width, int height) {
  return {(std::atan2(p.x, p.z) / (2 * pi) + 0.5) * width,
          (std::atan2(p.y, std::hypot(p.x, p.z)) / pi + 0.5) * height};
}

HemispherePixel hemisphere_pixel(const ColmapCamera& panorama, const Vec2d& pixel) {
  const double east = (pixel.x / panorama.width - 0.5) * 2 * pi;
  const double down = (pixel.y / panorama.height - 0.5) * pi;
  Vec3d p(std::cos(down) * std::sin(east), std::sin(down), std::cos(down) * std::cos(east));
  const bool is_back = p.z < 0;
  if (is_back) p = turned_back(p);
  const double r = std::hypot(p.x, p.y), psi = r > 0 ? std::atan2(r, p.z) / r : 1;
  const PinholeCamera<double> to = lens_camera(panorama, "").pinhole;
  return {is_back, {to.fx * psi * p.x + to.cx, to.fy * psi * p.y + to.cy}};
}

Image8 evened_panorama(const Image8& panorama) {
  const int width = panorama.width, channels = panorama.channels;
  Image8 result(width, panorama.height, channels);
  parallel_for(std::size_t(panorama.height), 16, [&](std::size_t y) {
    const double down = ((double(y) + 0.5) / panorama.height - 0.5) * pi;
    const double length = std::min(1 / std::cos(down), double(width));  // pixels
    std::vector<double> sums(std::size_t(width) + 1);  // of the pixels before each border
    for (int c = 0; c < channels; ++c) {
      for (int x = 0; x < width; ++x) sums[x + 1] = sums[x] + panorama.at(x, int(y), c);
      const auto sum_to = [&](double at) {  // from the row's begin, around the seam
        const double turns = std::floor(at / width), inside = at - turns * width;
        const int x = std::min(int(inside), width - 1);
        return turns * sums[width] + sums[x] + (inside - x) * (sums[x + 1] - sums[x]);
      };
      for (int x = 0; x < width; ++x) {
        const double middle = x + 0.5, half = length / 2;
        const double mean = (sum_to(middle + half) - sum_to(middle - half)) / length;
        result.at(x, int(y), c) = std::uint8_t(std::clamp(mean, 0.0, 255.0) + 0.5);
      }
    }
  });
  return result;
}

Image8 hemisphere_of(const Image8& panorama, const LensCamera& hemisphere, bool is_back,
                     const std::string& photo) {
  const PinholeCamera<double>& to = hemisphere.pinhole;
  const int first_column = is_back ? panorama.width / 2 : 0;
  return resampled(panorama, first_column, to, photo, [&](double x, double y) {
    const Vec2d u((x - to.cx) / to.fx, (y - to.cy) / to.fy);
    const double theta = std::sqrt(inner(u, u));
    const double scale = theta > 0 ? std::sin(theta) / theta : 1;
    const Vec3d p(scale * u.x, scale * u.y, std::cos(theta));
    return is_back ? turned_back(p) : p;
  });
}

Image8 pinhole_of(const Image8& panorama, const PinholeCamera<double>& camera,
                  const std::string& photo) {
  return resampled(panorama, 0, camera, photo, [&](double x, double y) {
    return multiply_transposed(camera.cam_from_world_rotation,
                               Vec3d((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1));
  });
}

}  // namespace gs
