// SPDX-License-Identifier: Apache-2.0
// The contract of a loss: how a rendered picture is compared with a photo.
//
// To add a loss, for example "charbonnier":
//   1. The formula goes into gs_core/math. The class (derived from Loss) and the function that makes
//      it go into a file of gs_train/stages; scalar_stages.h declares the function.
//   2. It becomes a row of kLosses in scalar_backend.cpp and a word of kLossWords in
//      gs_core/config/config_words.h. It compares what LossSettings::appearance shows, if there is
//      one.
//   3. Weights of its own are members of LossSettings and LossConfig, copied by Trainer::take_batch().
//   4. Its GPU twin is a row of kLosses in cuda/backend.cu. Without a twin, training on a GPU with
//      this loss is refused when the run starts.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "gs_core/buffer.h"
#include "gs_core/math/loss/area_filter.h"
#include "gs_core/math/render/surface_loss.h"
#include "gs_core/scene.h"
#include "gs_render/render_pass.h"
#include "gs_train/photometric/appearance.h"
#include "gs_train/photometric/photometric_state.h"

namespace gs {

/// The weights of a loss, given with each call. One struct serves all losses; each reads its own
/// members.
struct LossSettings {
  float lambda_dssim;  // l1_ssim: weight of 1 - SSIM; L1 has the rest
  // Weight of the depth loss (stages/depth_loss.cpp), for photos with a depth map; a backend adds
  // it to any loss. 0: maps teach nothing.
  float depth_weight = 0;
  // Of the surface terms (stages/surface_loss.cpp), which a backend adds to any loss as well.
  SurfaceWeights surface = {};
  // For devices that keep photos of their own: the picture is compared with the view's photo reduced
  // so many times. On the CPU the view is reduced already.
  int photo_reduction = 1;
  // With a photometric model, that of the view, which has shown the pass's picture. It replaces the
  // view's exposure: its shown() is compared with the photo, and the loss calls its pull_back().
  Appearance* appearance = nullptr;
  // What losses of a device know of the appearance; they show the picture themselves.
  const PhotoOnDevice* photo_on_device = nullptr;
};

/// What a loss of the program itself gets of one photo of a step, in the memory of the backend. It
/// is valid during the call. Copies by that Memory, and what is done on Device::stream(), come in the
/// order of the device's work; whoever reads or writes by other means waits first.
struct ComparedPicture {
  const std::string& name;  // of the view
  const Camera& camera;     // of the picture
  const float* image;       // (3, H, W)
  PhotoBytes photo;         // (H, W, 3)  of the same size, with its mask
  float* dL_dimage;         // (3, H, W)  to be written
  // (H, W)  null unless the loss sees depth: what is left for the background, and sums of weights
  // times depths; the gradients by alpha = 1 - transmittance and by the depths, to be written
  const float *transmittance, *depth;
  float *dL_dalpha, *dL_ddepth;
  const std::function<void()>& wait;  // for the device
};
/// Writes the gradient and returns the loss. What it throws ends the step, which has changed nothing
/// then. A device may call it again for a step whose first picture lacks Gaussians, because there was
/// too little room for them; what the first call writes, returns or throws does not count then.
using LossFunction = std::function<double(const ComparedPicture&)>;
/// A loss of the program. One that sees depth takes the place of the depth loss, too.
struct OwnLoss {
  LossFunction compare = nullptr;  // null: there is none
  bool sees_depth = false;
  // The loss of the last call, for a `compare` that cannot return it without waiting; null: it does.
  std::function<double()> value = nullptr;
};

/// A backend has one at a time, the one that Backend::use() named.
class Loss {
 public:
  virtual ~Loss() = default;
  /// Compares the pass's picture with the view's photo and writes dL/d(image), (3, H, W), into
  /// dL_dimage.
  virtual void forward_backward(const RenderPass& pass, const View& view,
                                const LossSettings& settings, Buffer<float>& dL_dimage) = 0;
  /// The loss of the last call. On a device this waits for it; the trainer asks only when it logs.
  virtual double value() = 0;
  /// True where it compares alpha and depth as well. Then passes have depths, the settings' depth
  /// loss rests, and set_depth_gradient() gives what the last call has left.
  virtual bool sees_depth() const { return false; }
  virtual void set_depth_gradient(PictureGradient&) const {}
  /// Whether pixels of the picture that the view's mask leaves out may change what it gives.
  virtual bool sees_masked_pixels() const { return false; }
};

/// The loss of a function, whose gradients lie in `memory`.
///
/// photo_of   the photo of a view, reduced so many times
/// wait       for the device
using FindPhoto = std::function<PhotoBytes(const View&, int reduction)>;
std::unique_ptr<Loss> make_function_loss(OwnLoss own, Memory& memory, FindPhoto photo_of,
                                         std::function<void()> wait);

}  // namespace gs
