// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/parts/foreign_flags.h"

#include <algorithm>
#include <iterator>

#include "gs_app/jobs/parts/option.h"

namespace gs {
namespace {

struct SameMeaning {
  std::string_view flag, key;  // theirs, and the setting here
};

constexpr SameMeaning kSameMeaning[] = {
    {"--data-dir", "dataset.source"},       {"--data-factor", "dataset.resolution"},
    {"--result-dir", "model.output"},       {"--lambda-dssim", "loss.lambda_dssim"},
    {"--ssim-lambda", "loss.lambda_dssim"},
};

struct OtherValue {
  std::string_view flag, own;  // SECTION.KEY=VALUE as theirs, and what to give here
};

constexpr OtherValue kOtherValues[] = {
    // The reference trainer shrinks photos that are wider than 1600 pixels.
    {"dataset.resolution=-1", "no -r: photos of more than 1600 pixels are reduced to 1600 anyway"},
};

}  // namespace

void foreign_options(OptionList& option, std::string_view section) {
  for (const SameMeaning& same : kSameMeaning)
    if (same.key.starts_with(section))
      option.setting(std::string(same.flag), std::string(same.key), "").hidden();
}

std::string own_value(std::string_view flag) {
  for (const OtherValue& other : kOtherValues)
    if (other.flag == flag) return std::string(other.own);
  return {};
}

}  // namespace gs
