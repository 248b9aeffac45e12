// SPDX-License-Identifier: Apache-2.0
// The contract of a photometric model: how photos differ in exposure and white balance, and what is
// learned of it.
//
// To add a model:
//   1. The formulas go into gs_core/math, with their gradients. The class (derived from
//      PhotometricModel), its Appearance and the function that makes it go into a file of this
//      folder, as in gains.cpp.
//   2. It becomes a row of kModels in photometric_model.cpp and a word of kPhotometricWords in
//      gs_core/config/config_words.h.
//   3. Settings of its own are members of PhotometricConfig.
//   4. Its GPU twin is in cuda/photo_terms/photometric.cu and cuda/loss/ssim.cu, beside gains, and
//      features_of() in cuda/backend.cu has its name. Without a twin, training on a GPU with this
//      model is refused when the run starts.
// Adam, the mean of zero, checkpoints, held-out photos, metrics and photometric.json then take it as
// they take the others.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gs_core/math/loss/photometric.h"
#include "gs_train/photometric/appearance.h"
#include "gs_train/photometric/photometric_state.h"

namespace gs {

struct PhotometricConfig;

/// All numbers of a model are 0 where a photo shows the scene's own colors. This is the scalar twin;
/// a device has kernels of its own and says in Features which models it knows.
class PhotometricModel {
 public:
  virtual ~PhotometricModel() = default;
  /// Their names, of each photo.
  virtual std::vector<std::string> photo_names() const = 0;
  /// The appearance of a photo with these numbers.
  virtual std::unique_ptr<Appearance> appearance(Span<const float> photo) const = 0;
  /// The numbers of a photo that shows the scene's colors times these gains, as far as the model
  /// can say it.
  virtual void start_from_gains(const Vec3f& gains, Span<float> photo) const = 0;
  /// How strongly the numbers of a photo are pulled towards their start.
  virtual PhotoPulls pulls(const PhotometricState& state) const = 0;
};

/// The word of photometric.model that means none.
inline constexpr const char* kNoPhotometricModel = "none";
/// The word that leaves the choice to the photos. A TrainSession replaces it by one of the others.
inline constexpr const char* kAutoPhotometricModel = "auto";

/// The model that the settings name; null: none. Throws UsageError for a word that is not in the
/// table, and for "auto", which nobody has replaced.
std::unique_ptr<PhotometricModel> make_photometric_model(const PhotometricConfig& config);

/// The words of photometric.model.
std::vector<std::string> photometric_models();

}  // namespace gs
