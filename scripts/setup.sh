#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing (Debian and Ubuntu) and builds into build/default all that `cmake --install` copies: the program,
# the C++ libraries and the Python module.
set -euo pipefail
source "$(dirname "$0")/common.sh"

install_packages
build default installed
say "Ready: build/default/bin/gemsplat --help"
if compgen -G 'build/default/python/gemsplat/_gemsplat*.so' >/dev/null; then
  python=$(sed -n 's/^_Python3_EXECUTABLE:INTERNAL=//p' build/default/CMakeCache.txt)
  say "For Python: export PYTHONPATH=$PWD/build/default/python; the module is built for ${python:-python3}"
fi
say "To install it: cmake --install build/default --prefix FOLDER"
