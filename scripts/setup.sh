#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing (Debian and Ubuntu) and builds the program into build/default.
set -euo pipefail
source "$(dirname "$0")/common.sh"

install_packages
build default gemsplat
say "Ready: build/default/bin/gemsplat --help"
