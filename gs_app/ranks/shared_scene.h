// SPDX-License-Identifier: Apache-2.0
// What rank 0 tells processes that are other ranks before the first step: which scene to load.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs {

/// The first message to rank 0.
struct RankHello {
  std::string nonce, version;
  int rank = 0;
};
std::vector<std::byte> message_of(const RankHello& hello);
RankHello hello_in(const std::vector<std::byte>& message);

/// Rank 0's answer, once it has its scene.
struct SharedScene {
  Config config;
  std::string scene_hash;  // scene_hash() of its files; empty: not known
  int threads = 0;         // for each of the other ranks; 0: all cores
  // Of the training views, which a resumed run, or photos that choose, may have changed
  std::vector<std::string> names;
  std::vector<Camera> cameras;
  std::vector<Vec3f> exposures;
};
SharedScene shared_scene(const Config& config, const Scene& scene, const std::string& scene_hash);
std::vector<std::byte> message_of(const SharedScene& shared);
SharedScene shared_scene_in(const std::vector<std::byte>& message);

/// Makes a scene that was loaded by the shared config the same as rank 0's. Throws Error where its
/// views are others.
void make_same(Scene& scene, const SharedScene& shared);

}  // namespace gs
