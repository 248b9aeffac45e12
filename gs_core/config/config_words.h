// SPDX-License-Identifier: Apache-2.0
// Settings that are one of a few words. Each is an enum with one table of its words: reading,
// printing, --help and the docs go through that table, so that a word which is not in it is refused
// everywhere. To add a word, add an enumerator and a row.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

#include "gs_core/error.h"
#include "gs_core/math/density/growth.h"
#include "gs_core/math/loss/depth_kind.h"
#include "gs_core/math/render/normal_axes.h"
#include "gs_core/math/render/render_rules.h"
#include "gs_core/math/update/moment_storage.h"

namespace gs {

/// The color behind the Gaussians; `random` is another one in each step.
enum class Background { black, white, random };
/// What is behind all sparse points at the start: nothing, or far Gaussians on a sphere where
/// photos show something.
/// How the CUDA backend blends: as matrix products on tensor cores (blend_gemm.cu), or pixel by
/// pixel.
enum class BlendKernel { gemm, simt };
/// What a masked pixel of a photo means: nothing is known of it, or it shows the background.
enum class MaskMode { automatic, ignore, background };
/// How photos with a lens train: as pinhole pictures made of them, or as they are.
enum class LensUse { automatic, undistort, native };
/// Which pairs of photos COLMAP compares.
enum class Matching { automatic, exhaustive, sequential, retrieval };
/// How COLMAP places cameras: one after another, or all at once.
enum class Mapper { automatic, incremental, global };
/// How the times of photos are found in scenes of COLMAP.
enum class PhotoTimes { none, frames, names };
/// Whether all photos were taken through one lens.
enum class SingleCamera { automatic, yes, no };

/// One row of a table of words.
template <class E>
struct Word {
  std::string_view text;
  E value;
};

/// The table of an enum's words, in the order in which help lists them.
template <class E>
struct Words;
template <>
struct Words<Background> {
  static constexpr Word<Background> kTable[] = {
      {"black", Background::black}, {"white", Background::white}, {"random", Background::random}};
};
template <>
struct Words<BlendRule> {
  static constexpr Word<BlendRule> kTable[] = {{"faster_gs", BlendRule::faster_gs},
                                               {"classic", BlendRule::classic}};
};
template <>
struct Words<RenderOrder> {
  static constexpr Word<RenderOrder> kTable[] = {{"z", RenderOrder::z},
                                                 {"pixel", RenderOrder::pixel}};
};
template <>
struct Words<Truncation> {
  static constexpr Word<Truncation> kTable[] = {{"alpha", Truncation::alpha},
                                                {"sigma2", Truncation::sigma2},
                                                {"sigma3", Truncation::sigma3},
                                                {"sigma4", Truncation::sigma4}};
};
template <>
struct Words<TileBounds> {
  static constexpr Word<TileBounds> kTable[] = {
      {"exact", TileBounds::exact}, {"box", TileBounds::box}, {"square", TileBounds::square}};
};
template <>
struct Words<BlendKernel> {
  static constexpr Word<BlendKernel> kTable[] = {{"gemm", BlendKernel::gemm},
                                                 {"simt", BlendKernel::simt}};
};
template <>
struct Words<MaskMode> {
  static constexpr Word<MaskMode> kTable[] = {{"auto", MaskMode::automatic},
                                              {"ignore", MaskMode::ignore},
                                              {"background", MaskMode::background}};
};
template <>
struct Words<LensUse> {
  static constexpr Word<LensUse> kTable[] = {
      {"auto", LensUse::automatic}, {"undistort", LensUse::undistort}, {"native", LensUse::native}};
};
template <>
struct Words<DepthKind> {
  static constexpr Word<DepthKind> kTable[] = {{"auto", DepthKind::automatic},
                                               {"metric", DepthKind::metric},
                                               {"scaled", DepthKind::scaled},
                                               {"relative", DepthKind::relative},
                                               {"inverse", DepthKind::inverse}};
};
template <>
struct Words<NormalAxes> {
  static constexpr Word<NormalAxes> kTable[] = {{"world", NormalAxes::world},
                                                {"rdf", NormalAxes::rdf},
                                                {"rub", NormalAxes::rub},
                                                {"lub", NormalAxes::lub}};
};
template <>
struct Words<Matching> {
  static constexpr Word<Matching> kTable[] = {{"auto", Matching::automatic},
                                              {"exhaustive", Matching::exhaustive},
                                              {"sequential", Matching::sequential},
                                              {"retrieval", Matching::retrieval}};
};
template <>
struct Words<Mapper> {
  static constexpr Word<Mapper> kTable[] = {{"auto", Mapper::automatic},
                                            {"incremental", Mapper::incremental},
                                            {"global", Mapper::global}};
};
template <>
struct Words<SingleCamera> {
  static constexpr Word<SingleCamera> kTable[] = {
      {"auto", SingleCamera::automatic}, {"yes", SingleCamera::yes}, {"no", SingleCamera::no}};
};

template <>
struct Words<PhotoTimes> {
  static constexpr Word<PhotoTimes> kTable[] = {
      {"none", PhotoTimes::none}, {"frames", PhotoTimes::frames}, {"names", PhotoTimes::names}};
};

template <>
struct Words<GrowthScore> {
  static constexpr Word<GrowthScore> kTable[] = {{"gradient", GrowthScore::gradient},
                                                 {"force", GrowthScore::force},
                                                 {"error", GrowthScore::error},
                                                 {"mask", GrowthScore::mask},
                                                 {"edge", GrowthScore::edge}};
};
template <>
struct Words<MomentStorage> {
  static constexpr Word<MomentStorage> kTable[] = {{"float", MomentStorage::floats},
                                                   {"half", MomentStorage::halves}};
};

/// Lists of words that stay text, since other code gives them their meaning. "cuda:N" stands for
/// any number N.
inline constexpr std::string_view kLossWords = "l1_ssim";                   // scalar_backend.cpp
inline constexpr std::string_view kPhotometricWords = "none, gains, auto";  // photometric_model.cpp
inline constexpr std::string_view kDeviceWords = "auto, cpu, cuda, cuda:N";
inline constexpr std::string_view kLensWords =  // COLMAP's names
    "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, "
    "SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE";

/// The word of a value, as config files have it.
template <class E>
std::string_view word_of(E value) {
  for (const Word<E>& word : Words<E>::kTable)
    if (word.value == value) return word.text;
  GS_CHECK(false);  // not an enumerator
  return {};
}

/// The value that a word stands for; nothing for an unknown word.
template <class E>
std::optional<E> value_of_word(std::string_view text) {
  for (const Word<E>& word : Words<E>::kTable)
    if (word.text == text) return word.value;
  return std::nullopt;
}

/// "black, white, random"
template <class E>
std::string_view joined_words() {
  static const std::string joined = [] {
    std::string text;
    for (const Word<E>& word : Words<E>::kTable)
      text.append(text.empty() ? "" : ", ").append(word.text);
    return text;
  }();
  return joined;
}

}  // namespace gs
