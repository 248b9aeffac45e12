// SPDX-License-Identifier: Apache-2.0
#include "gs_app/ranks/shared_scene.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/config/setting_lines.h"
#include "gs_core/error.h"
#include "gs_core/processes/packing.h"

namespace gs {

std::vector<std::byte> message_of(const RankHello& hello) {
  Packer packer;
  packer.text(hello.nonce);
  packer.text(hello.version);
  packer.value(hello.rank);
  return packer.take();
}

RankHello hello_in(const std::vector<std::byte>& message) {
  Unpacker unpacker(message);
  RankHello hello;
  hello.nonce = unpacker.text();
  hello.version = unpacker.text();
  hello.rank = unpacker.value<int>();
  return hello;
}

SharedScene shared_scene(const Config& config, const Scene& scene, const std::string& scene_hash) {
  SharedScene shared{config, scene_hash, 0, {}, {}, {}};
  for (const View& view : scene.train_views) {
    shared.names.push_back(view.name);
    shared.cameras.push_back(view.camera);
    shared.exposures.push_back(view.exposure);
  }
  return shared;
}

std::vector<std::byte> message_of(const SharedScene& shared) {
  Packer packer;
  packer.text(setting_lines(shared.config));
  packer.text(shared.scene_hash);
  packer.value(shared.threads);
  packer.value(shared.names.size());
  for (const std::string& name : shared.names) packer.text(name);
  packer.list(shared.cameras);
  packer.list(shared.exposures);
  return packer.take();
}

SharedScene shared_scene_in(const std::vector<std::byte>& message) {
  Unpacker unpacker(message);
  SharedScene shared;
  shared.config = config_of_lines(unpacker.text());
  shared.scene_hash = unpacker.text();
  shared.threads = unpacker.value<int>();
  for (auto left = unpacker.value<std::size_t>(); left > 0; --left)
    shared.names.push_back(unpacker.text());
  shared.cameras = unpacker.list<Camera>();
  shared.exposures = unpacker.list<Vec3f>();
  return shared;
}

void make_same(Scene& scene, const SharedScene& shared) {
  bool are_same = scene.train_views.size() == shared.names.size();
  for (std::size_t i = 0; are_same && i < shared.names.size(); ++i) {
    View& view = scene.train_views[i];
    are_same = view.name == shared.names[i] && view.camera.width == shared.cameras[i].width &&
               view.camera.height == shared.cameras[i].height;
    view.camera = shared.cameras[i];
    view.exposure = shared.exposures[i];
  }
  if (!are_same)
    throw Error(
        fmt::format("{} has other photos here than rank 0 has found; give all ranks the "
                    "same scene, for example on a disk that they share",
                    scene.source));
}

}  // namespace gs
