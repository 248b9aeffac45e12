// SPDX-License-Identifier: Apache-2.0
#include "cuda/device/unserved_card.h"

namespace gs::cuda {
namespace {

// 86 is "8.6".
std::string text_of(Capability capability) {
  return std::to_string(capability / 10) + "." + std::to_string(capability % 10);
}

std::string list_of(const std::vector<Capability>& capabilities) {
  std::string list;
  for (const Capability capability : capabilities)
    list += (list.empty() ? "" : ", ") + text_of(capability);
  return list;
}

}  // namespace

std::string unserved_card(const std::string& name, Capability capability,
                          const std::vector<Capability>& built_for) {
  const std::string card = name + " (compute capability " + text_of(capability) + ")";
  if (capability < kOldestCapability)
    return "gemsplat does not run on " + card + ": it needs compute capability " +
           text_of(kOldestCapability) +
           " or later; use another GPU (--device cuda:N) or --device cpu";
  return "this build of gemsplat has no code that " + card +
         " and its driver can run: it was made for compute capability " + list_of(built_for) +
         "; build it for this card with `cmake --preset default -DGS_CUDA_ARCHITECTURES=" +
         std::to_string(capability) +
         " && cmake --build --preset default`, for every card with the preset `portable`, or use "
         "--device cpu";
}

}  // namespace gs::cuda
