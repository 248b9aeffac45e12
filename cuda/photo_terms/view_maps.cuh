// SPDX-License-Identifier: Apache-2.0
// Maps of photos on the GPU: depths and normals.
#pragma once

#include <unordered_map>

#include "gs_core/buffer.h"
#include "gs_core/scene.h"

namespace gs::cuda {

/// The maps of one kind, of the views that steps have used so far. A map is uploaded when its view is
/// first trained on, which waits for the device, and stays.
template <class T>
class ViewMaps {
 public:
  ViewMaps(Memory& memory, Image<T> View::*map) : memory_(memory), map_(map) {}
  struct Map {
    Buffer<T> values;  // (height, width, channels)
    DepthKind kind;    // of depths
  };
  /// That of a view that has one. Throws Error where memory runs out.
  const Map& of(const View& view) {
    const auto known = maps_.find(&view);
    if (known != maps_.end()) return known->second;
    const std::shared_ptr<const View> loaded = with_photo(view);
    Map map{Buffer<T>(memory_), loaded->depth_kind};
    map.values.upload(((*loaded).*map_).pixels);
    return maps_.emplace(&view, std::move(map)).first->second;
  }
  void forget() { maps_.clear(); }

 private:
  Memory& memory_;
  Image<T> View::*map_;
  std::unordered_map<const View*, Map> maps_;
};

}  // namespace gs::cuda
