# SPDX-License-Identifier: Apache-2.0
"""Open3D is imported by the peers and used for their meshing only, which `gemsplat mesh` replaces."""
