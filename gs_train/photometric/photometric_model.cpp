// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/photometric_model.h"

#include "gs_core/config/config.h"
#include "gs_core/error.h"
#include "gs_train/named_row.h"
#include "gs_train/photometric/gains.h"

namespace gs {
namespace {

// Photos and tracks are read above this library.
std::unique_ptr<PhotometricModel> refuse_auto() {
  throw UsageError(
      "photometric.model is auto, and a Trainer by itself does not look at the scene's tracks: "
      "train with a TrainSession of gs_app/session, or set photometric.model to gains or none");
}

struct ModelRow {
  const char* name;  // a word of photometric.model
  std::unique_ptr<PhotometricModel> (*make)();
};
constexpr ModelRow kModels[] = {
    {kNoPhotometricModel, [] { return std::unique_ptr<PhotometricModel>(); }},
    {kGainsModel, make_gains_model},
    {kAutoPhotometricModel, refuse_auto},
};

}  // namespace

std::unique_ptr<PhotometricModel> make_photometric_model(const PhotometricConfig& config) {
  return row_named(kModels, config.model, "photometric.model")->make();
}

std::vector<std::string> photometric_models() { return names_of(kModels); }

}  // namespace gs
