# SPDX-License-Identifier: Apache-2.0
"""trimesh is imported by the peers and used for their marching tetrahedra only."""
