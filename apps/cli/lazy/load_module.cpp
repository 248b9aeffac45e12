// SPDX-License-Identifier: Apache-2.0
#include <dlfcn.h>

#include "apps/cli/lazy/modules.h"
#include "gs_core/error.h"

namespace gs {

const void* load_module(const std::string& file, const std::string& symbol) {
  namespace fs = std::filesystem;
  const fs::path program = fs::read_symlink("/proc/self/exe");
  const fs::path module = program.parent_path().parent_path() / "lib" / "gemsplat" / file;
  void* const handle = dlopen(module.c_str(), RTLD_NOW | RTLD_LOCAL);
  const void* const table = handle ? dlsym(handle, symbol.c_str()) : nullptr;
  if (!table)
    throw Error("cannot load " + module.string() + ": " + std::string(dlerror()) +
                "; keep the folders bin and lib of gemsplat together, or install it again");
  return table;
}

}  // namespace gs
