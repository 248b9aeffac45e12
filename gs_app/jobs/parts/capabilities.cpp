// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/parts/capabilities.h"

#include "gs_app/jobs/parts/features.h"
#include "gs_app/run/make_backend.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

Capability cuda_capability() {
  const int count = cuda_device_count();
  if (count > 0)
    return {"CUDA", true, "trains and renders on " + std::to_string(count) + " GPU(s)"};
  return {"CUDA", false, (has_cuda() ? "this build has CUDA, but " : "") + why_no_gpu()};
}

}  // namespace

std::vector<Capability> capabilities() {
  std::vector<Capability> all = {
      {"CPU", true, "trains and renders on " + std::to_string(thread_count()) + " threads"},
      cuda_capability()};
  for (const Feature& feature : kFeatures)
    all.push_back({feature.name, feature.is_there, feature.detail});
  return all;
}

}  // namespace gs
