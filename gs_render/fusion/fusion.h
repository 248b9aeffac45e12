// SPDX-License-Identifier: Apache-2.0
// From what views show to a volume, on the CPU or on the device of a renderer.
#pragma once

#include <functional>

#include "gs_core/gaussians.h"
#include "gs_render/fusion/depth_view.h"
#include "gs_render/fusion/volume.h"
#include "gs_render/render_pass.h"

namespace gs {

/// The memory that a volume takes with its mesh.
struct VolumeForecast {
  double voxel = 0;                // that blocks were counted with, world units
  double blocks = 0, lattice = 0;  // near surfaces; of the whole frame, where it is looked through

  /// Bytes with voxels of another size: surfaces have as many more blocks as the square.
  double bytes_at(double size) const;
};

/// Called with the number of parts that are done, and of all.
using FusionProgress = std::function<void(std::size_t done, std::size_t total)>;

/// Fuses views, each voxel by itself and in the order of the views, so that the result does not
/// depend on threads or on the device. A voxel at p, at depth z on the ray u of a view (z = 1), has
/// there
///
///   d = (1/o - z) cos |u|,   s = min(d / truncation, 1),   weight  g = cos^2 o^2 min(1 + s, 1)
///
/// where o and cos are the pixel's inverse depth and facing, and gets sum g s / sum g over the views
/// with s > -1. Behind a surface the weight falls (Bylow et al. 2013): the ray may have left the
/// thing there. Where three views more than thrice those that see a
/// surface look through a voxel, it is air. Two views must agree that there is anything, if there
/// are two, and of a closed surface one for every eight before which the voxel is hidden.
///
/// Order of calls: add() for each view, maybe drop_doubtful(), then
///
///   const VolumeFrame frame = fusion.frame(voxel);
///   TriangleMesh mesh = surface_of(fusion.fuse(frame, progress));       // marching_cubes.h
///   color_vertices(fusion.views(), voxel, mesh);
///
/// This class computes on the CPU. Renderer::fusion() makes that of a renderer's device.
class Fusion {
 public:
  explicit Fusion(const FusionRule& rule) : rule_(rule) {}
  virtual ~Fusion() = default;
  Fusion(const Fusion&) = delete;
  Fusion& operator=(const Fusion&) = delete;

  virtual void add(DepthView view) { views_.push_back(std::move(view)); }
  /// Adds what a pass shows: the result of Renderer::forward(), for a backward pass, of the Gaussians
  /// without time. Passes and Gaussians are in the renderer's memory.
  virtual void add(const GaussiansSpan& gaussians, const Camera& camera,
                   const RenderSettings& settings, const RenderPass& pass, Image8 color);
  const std::vector<DepthView>& views() const { return views_; }
  /// Forgets the depth of pixels with which no other view agrees (agreement.h); of two views at
  /// least. Once, after all views were added.
  virtual void drop_doubtful();
  /// Ends the fusion.
  std::vector<DepthView> take_views() { return std::move(views_); }

  /// The size of a pixel on the surface that it shows: 1 / (o f), the median over pixels of all
  /// views.   world units; 0 where no pixel shows a surface
  float median_pixel() const;
  /// The box of what the views show, without the outermost hundredth of the points along each axis
  /// at either end, and with a twentieth more. `voxel` > 0.
  VolumeFrame frame(float voxel) const;
  /// Counts the blocks, with voxels as large as the median pixel at least, which is quick.
  VolumeForecast forecast(float voxel);
  /// The blocks that a surface meets within the truncation, ascending.
  virtual std::vector<std::uint64_t> surface_blocks(const VolumeFrame& frame);
  Volume fuse(const VolumeFrame& frame, const FusionProgress& progress = {});

 protected:
  /// Whether the first voxel of each block of a frame is air.
  virtual std::vector<char> air_at_corners(const VolumeFrame& frame);
  /// Writes the distances of blocks.   (B, 512)
  virtual void fill(const VolumeFrame& frame, Span<const std::uint64_t> keys,
                    Span<const BlockKind> kinds, float* distance);
  /// How many views must agree.
  int least_views() const { return views_.size() < 2 ? int(views_.size()) : 2; }

  const FusionRule rule_;
  std::vector<DepthView> views_;
};

}  // namespace gs
