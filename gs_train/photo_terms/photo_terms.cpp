// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photo_terms/photo_term.h"

namespace gs {
namespace {

// In the order of their calls: depth is compared before the picture is shown.
constexpr MakePhotoTerm* kPhotoTerms[] = {make_depth_term, make_surface_term, make_gains_term,
                                          make_pose_term};

}  // namespace

PhotoTerms make_photo_terms(const std::shared_ptr<const PhotometricModel>& photometric) {
  PhotoTerms terms;
  for (MakePhotoTerm* const make : kPhotoTerms) terms.push_back(make(photometric));
  return terms;
}

}  // namespace gs
