// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/photometric_model.h"

#include "gs_train/named_row.h"
#include "gs_train/photometric/gains.h"

namespace gs {
namespace {

struct ModelRow {
  const char* name;  // a word of photometric.model
  std::unique_ptr<PhotometricModel> (*make)(const PhotometricConfig&);
};
constexpr ModelRow kModels[] = {
    {kNoPhotometricModel,
     [](const PhotometricConfig&) { return std::unique_ptr<PhotometricModel>(); }},
    {"gains", make_gains_model},
};

}  // namespace

std::unique_ptr<PhotometricModel> make_photometric_model(const PhotometricConfig& config) {
  return row_named(kModels, config.model, "photometric.model")->make(config);
}

std::vector<std::string> photometric_models() { return names_of(kModels); }

}  // namespace gs
