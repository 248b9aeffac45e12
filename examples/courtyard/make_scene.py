# SPDX-License-Identifier: Apache-2.0
# SPDX-FileCopyrightText: The gemsplat authors
"""Model and render the "courtyard" photo set with Blender 3.4 (Cycles, CPU).

    blender -b -P make_scene.py -- --out /tmp/scene/round0 [--samples 8] [--only 0,12]

Everything here is procedural: meshes are built by the small functions below and
textures are shader nodes, so the set has no third-party assets.  Units are meters.

Rules that the scene follows because the pictures feed structure from motion and
Gaussian splatting:
  * nothing moves, exposure is fixed, no depth of field, no motion blur;
  * every surface has texture of 5-40 mm (a pixel covers about 3 mm on the table),
    so that SIFT finds points everywhere and finer detail does not alias;
  * walls and floor close the view, so that every pixel has content at a finite depth;
  * lit by sun and open sky: nearly all light is direct, hence little render noise
    (Debian's Blender has no denoiser).
"""
import argparse
import math
import os
import random
import sys
import time

import bpy
from mathutils import Euler, Matrix, Vector, noise

RNG = random.Random(7)
TABLE_Z = 0.75          # height of the table's surface
HALF_X, HALF_Y = 2.8, 2.6  # the walls stand at x = +-HALF_X and y = +-HALF_Y


# ---------------------------------------------------------------- shader helpers
class Shader:
    """A material under construction; each method adds one node and returns its output."""

    def __init__(self, name, roughness=0.8, specular=0.2):
        self.mat = bpy.data.materials.new(name)
        self.mat.use_nodes = True
        self.tree = self.mat.node_tree
        self.bsdf = self.tree.nodes["Principled BSDF"]
        self.bsdf.inputs["Roughness"].default_value = roughness
        self.bsdf.inputs["Specular"].default_value = specular
        self.tones = []         # every color of the material, for its mean (see finish)

    def set(self, socket, value):
        """Link `value` if it is another node's output, else store it as a constant."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif isinstance(value, tuple) and socket.type == "RGBA":
            self.tones.append(value[:3])
            socket.default_value = (*value[:3], 1.0)
        else:
            socket.default_value = value

    def node(self, kind, inputs=(), out=0, **props):
        node = self.tree.nodes.new("ShaderNode" + kind)
        for key, value in props.items():
            setattr(node, key, value)
        for key, value in dict(inputs).items():
            self.set(node.inputs[key], value)
        return node.outputs[out]

    def coords(self, scale=(1, 1, 1), kind="Object", vary=False):
        """Texture coordinates; `vary` shifts them per object so that copies differ."""
        vec = self.node("TexCoord", out=kind)
        if vary:
            shift = self.math("MULTIPLY", self.node("ObjectInfo", out="Random"), 41.0)
            vec = self.node("VectorMath", {0: vec, 1: shift}, operation="ADD")
        return self.node("Mapping", {"Vector": vec, "Scale": scale})

    def noise(self, vec, scale, detail=4.0, rough=0.55, distortion=0.0):
        return self.node("TexNoise", {"Vector": vec, "Scale": scale, "Detail": detail,
                                      "Roughness": rough, "Distortion": distortion})

    def voronoi(self, vec, scale, feature="F1", out="Distance", randomness=1.0):
        return self.node("TexVoronoi", {"Vector": vec, "Scale": scale,
                                        "Randomness": randomness}, out=out, feature=feature)

    def wave(self, vec, scale, distortion=0.0, direction="X", detail=2.0, detail_scale=1.0,
             kind="BANDS"):
        props = {"wave_type": kind}
        props["bands_direction" if kind == "BANDS" else "rings_direction"] = direction
        return self.node("TexWave", {"Vector": vec, "Scale": scale, "Distortion": distortion,
                                     "Detail": detail, "Detail Scale": detail_scale}, **props)

    def math(self, op, a, b=0.0):
        return self.node("Math", {0: a, 1: b}, operation=op)

    def ramp(self, value, *stops, interpolation="LINEAR"):
        """Color ramp; a stop is (position, color) with a gray number or an RGB tuple."""
        node = self.tree.nodes.new("ShaderNodeValToRGB")
        ramp = node.color_ramp
        ramp.interpolation = interpolation
        while len(ramp.elements) < len(stops):
            ramp.elements.new(1.0)
        for element, (pos, col) in zip(ramp.elements, stops):
            element.position = pos
            if isinstance(col, tuple):
                self.tones.append(col)
            element.color = (*col, 1.0) if isinstance(col, tuple) else (col, col, col, 1.0)
        self.set(node.inputs[0], value)
        return node.outputs[0]

    def mix(self, fac, a, b, blend="MIX"):
        return self.node("MixRGB", {"Fac": fac, "Color1": a, "Color2": b}, blend_type=blend)

    def speckle(self, color, vec, scale, amount=0.35):
        """Multiply fine light and dark blotches in: the texture that SIFT lives on."""
        spots = self.ramp(self.noise(vec, scale, 2.0, 0.7), (0.35, 1 - amount), (0.65, 1.0))
        return self.mix(1.0, color, spots, "MULTIPLY")

    def finish(self, color, height=None, strength=0.5, distance=0.01):
        self.set(self.bsdf.inputs["Base Color"], color)
        if height is not None:
            bump = self.node("Bump", {"Height": height, "Strength": strength,
                                      "Distance": distance})
            self.set(self.bsdf.inputs["Normal"], bump)
        self.output(self.bsdf.outputs[0])
        return self.mat

    def output(self, full):
        """Only what the camera sees runs the textures; bounced light meets a mean color.

        Cycles skips the branch of a mix shader whose weight is nought, so this halves the
        time of a sample, and the light that a wall throws back has no texture anyway.
        """
        mean = tuple(0.75 * sum(t[k] for t in self.tones) / max(1, len(self.tones))
                     for k in range(3))
        cheap = self.node("BsdfDiffuse", {"Color": mean})
        seen = self.node("LightPath", out="Is Camera Ray")
        both = self.node("MixShader", {"Fac": seen, 1: cheap, 2: full})
        self.set(self.tree.nodes["Material Output"].inputs["Surface"], both)


# ---------------------------------------------------------------- materials
def wood(name, dark, light, stretch=(1.0, 14.0, 14.0), wear=None):
    """Grain along local x, different on each object; `wear` is a paint color flaking off."""
    s = Shader(name, 0.65, 0.25)
    vec = s.coords(stretch, vary=True)
    grain = s.noise(vec, 2.2, 4.0, 0.6, 1.6)
    fibre = s.noise(s.coords((4.0, 60.0, 60.0), vary=True), 1.0, 2.0, 0.6)
    rings = s.wave(vec, 0.35, 16.0, "Y", 2.0, 0.7)
    value = s.mix(0.3, s.mix(0.22, grain, rings), fibre)
    col = s.ramp(value, (0.33, dark), (0.5, tuple((2 * a + 3 * b) / 5 for a, b in zip(dark, light))),
                 (0.66, light))
    stain = s.ramp(s.noise(s.coords((3, 6, 6), vary=True), 1.6, 3.0), (0.38, 0.55), (0.6, 1.0))
    col = s.mix(1.0, col, stain, "MULTIPLY")
    tint = s.ramp(s.node("ObjectInfo", out="Random"), (0.0, 0.68), (1.0, 1.0))
    col = s.mix(1.0, col, tint, "MULTIPLY")
    col = s.speckle(col, s.coords(vary=True), 55.0, 0.4)
    if wear:
        mask = s.ramp(s.noise(s.coords((3, 12, 12), vary=True), 2.2, 4.0, 0.7),
                      (0.40, 0.0), (0.47, 1.0))
        paint = s.speckle(wear, s.coords(vary=True), 25.0, 0.45)
        col = s.mix(mask, col, paint)
    return s.finish(col, value, 0.5, 0.006)


def bricks(name, col_a, col_b, mortar, lime=None):
    s = Shader(name, 0.9, 0.1)
    vec = s.coords()
    wobble = s.mix(0.02, vec, s.node("TexNoise", {"Vector": vec, "Scale": 4.0}, out="Color"))
    args = {"Vector": wobble, "Color1": col_a, "Color2": col_b, "Mortar": mortar, "Scale": 1.0,
            "Mortar Size": 0.007, "Mortar Smooth": 0.3, "Bias": -0.1, "Brick Width": 0.215,
            "Row Height": 0.075}
    node = s.tree.nodes.new("ShaderNodeTexBrick")
    for key, value in args.items():
        s.set(node.inputs[key], value)
    col, gap = node.outputs["Color"], node.outputs["Fac"]
    col = s.mix(0.5, col, s.ramp(s.noise(vec, 7.0, 4.0, 0.7), (0.3, 0.12), (0.7, 0.9)), "OVERLAY")
    col = s.speckle(col, vec, 60.0, 0.55)
    if lime:
        mask = s.ramp(s.noise(vec, 2.6, 6.0, 0.72), (0.40, 0.0), (0.50, 1.0))
        col = s.mix(mask, col, s.speckle(s.speckle(lime, vec, 30.0, 0.3), vec, 8.0, 0.3))
    height = s.mix(0.75, s.noise(vec, 45.0, 2.0), s.math("SUBTRACT", 1.0, gap))
    return s.finish(col, height, 0.8, 0.014)


def plaster(name):
    """Ochre plaster that has come off in places and shows bricks below."""
    s = Shader(name, 0.9, 0.1)
    vec = s.coords()
    coat = s.ramp(s.noise(vec, 1.4, 5.0, 0.68), (0.3, (0.50, 0.27, 0.10)),
                  (0.5, (0.66, 0.42, 0.19)), (0.7, (0.74, 0.55, 0.32)))
    coat = s.speckle(s.speckle(coat, vec, 40.0, 0.35), vec, 14.0, 0.3)
    cracks = s.ramp(s.voronoi(s.mix(0.12, vec, s.node("TexNoise", {"Vector": vec, "Scale": 3.0},
                                                      out="Color")), 2.2, "DISTANCE_TO_EDGE"),
                    (0.0, 0.25), (0.012, 1.0))
    coat = s.mix(1.0, coat, cracks, "MULTIPLY")
    brick = s.node("TexBrick", {"Vector": vec, "Color1": (0.36, 0.12, 0.06),
                                "Color2": (0.23, 0.10, 0.06), "Mortar": (0.42, 0.36, 0.28),
                                "Scale": 1.0, "Mortar Size": 0.007, "Brick Width": 0.215,
                                "Row Height": 0.075})
    brick = s.speckle(brick, vec, 55.0, 0.6)
    mask = s.ramp(s.noise(vec, 1.1, 5.0, 0.6), (0.40, 0.0), (0.42, 1.0))
    height = s.mix(0.6, s.noise(vec, 30.0, 3.0, 0.7), mask)
    return s.finish(s.mix(mask, brick, coat), height, 0.7, 0.015)


def rubble(name, scale, tones, joint, stretch=(1, 1, 1), flat=False):
    """Irregular stones (Voronoi cells) with joints: a dry wall, or paving if `flat`."""
    s = Shader(name, 0.85, 0.15)
    vec = s.coords(stretch)
    bent = s.mix(0.07, vec, s.node("TexNoise", {"Vector": vec, "Scale": 2.5, "Detail": 4.0},
                                   out="Color"))
    cell = s.node("SeparateColor", {0: s.voronoi(bent, scale, out="Color")}, out=0)
    edge = s.voronoi(bent, scale, "DISTANCE_TO_EDGE")
    stone = s.ramp(cell, *[(i / (len(tones) - 1), c) for i, c in enumerate(tones)])
    veins = s.noise(vec, 9.0, 4.0, 0.72, 0.6)
    stone = s.mix(0.75, stone, s.ramp(veins, (0.3, 0.1), (0.7, 0.9)), "OVERLAY")
    stone = s.speckle(stone, vec, 48.0, 0.5)
    gap = s.ramp(edge, (0.03, 0.0), (0.075, 1.0))
    moss = s.ramp(s.noise(vec, 3.0, 5.0), (0.42, joint), (0.58, (0.05, 0.075, 0.02)))
    moss = s.speckle(moss, vec, 50.0, 0.7)
    height = s.mix(0.35, s.ramp(edge, (0.0, 0.0), (0.1 if flat else 0.3, 1.0)), veins)
    return s.finish(s.mix(gap, moss, stone), height, 0.9, 0.02 if flat else 0.05)


def terracotta(name):
    s = Shader(name, 0.9, 0.1)
    vec = s.coords(vary=True)
    col = s.ramp(s.noise(vec, 9.0, 4.0, 0.7), (0.3, (0.30, 0.10, 0.05)), (0.5, (0.50, 0.20, 0.10)),
                 (0.72, (0.66, 0.46, 0.34)))
    return s.finish(s.speckle(col, vec, 90.0, 0.5), s.noise(vec, 60.0), 0.4, 0.004)


def foliage(name, dark, light):
    """Leaves: one mesh holds many, colored one by one; some light shines through."""
    s = Shader(name, 0.6, 0.25)
    one = s.node("NewGeometry", out="Random Per Island")
    col = s.ramp(one, (0.0, dark), (0.6, tuple((a + b) / 2 for a, b in zip(dark, light))),
                 (1.0, light))
    rib = s.ramp(s.node("SeparateXYZ", {0: s.coords(kind="UV")}, out=0), (0.44, 1.0), (0.5, 1.7),
                 (0.56, 1.0))
    col = s.mix(1.0, s.speckle(col, s.coords(), 80.0, 0.45), rib, "MULTIPLY")
    s.finish(col)
    through = s.node("BsdfTranslucent", {"Color": col})
    both = s.node("MixShader", {"Fac": 0.25, 1: s.bsdf.outputs[0], 2: through})
    s.output(both)
    return s.mat


def painted_ceramic(name, ground, ink, accent, repeat, gloss=0.3):
    """Glazed ware painted with flowers and bands in the lathe's (angle, profile) coordinates."""
    s = Shader(name, gloss, 0.45)
    vec = s.coords((*repeat, 1), "UV")
    dist = s.voronoi(vec, 1.0, randomness=0.55)
    petals = s.noise(vec, 3.2, 2.0)
    value = s.math("ADD", dist, s.math("MULTIPLY", petals, 0.22))
    col = s.ramp(value, (0.0, accent), (0.22, ground), (0.27, ink), (0.44, ground),
                 (0.56, ink), (0.62, ground), interpolation="CONSTANT")
    height = s.node("SeparateXYZ", {0: s.coords(kind="UV")}, out=1)
    band = s.ramp(height, (0.0, 0.0), (0.06, 1.0), (0.085, 0.0), (0.84, 1.0), (0.87, 0.0),
                  (0.90, 1.0), (0.93, 0.0), interpolation="CONSTANT")
    col = s.mix(band, col, ink)
    return s.finish(s.speckle(col, s.coords(vary=True), 70.0, 0.22), s.noise(vec, 9.0), 0.1, 0.002)


def cloth(name):
    """Table runner: linen with woven stripes, checks, a dotted border and a coarse weave."""
    s = Shader(name, 0.95, 0.05)
    uv = s.coords(kind="UV")                     # meters: u across, v along
    stripes = s.ramp(s.wave(uv, 2.6), (0.0, (0.50, 0.06, 0.04)), (0.30, (0.72, 0.62, 0.46)),
                     (0.62, (0.72, 0.62, 0.46)), (0.66, (0.10, 0.14, 0.26)),
                     (0.78, (0.72, 0.62, 0.46)), (0.92, (0.50, 0.06, 0.04)),
                     interpolation="CONSTANT")
    checks = s.ramp(s.wave(uv, 2.6, direction="Y"), (0.0, (0.62, 0.28, 0.18)), (0.25, 1.0),
                    (0.66, (0.45, 0.48, 0.60)), (0.74, 1.0), interpolation="CONSTANT")
    col = s.mix(0.8, stripes, checks, "MULTIPLY")
    dots = s.ramp(s.voronoi(uv, 26.0, randomness=0.25), (0.0, 1.0), (0.24, 0.0),
                  interpolation="CONSTANT")
    col = s.mix(s.math("MULTIPLY", dots, 0.75), col, (0.78, 0.52, 0.10))
    weave = s.mix(0.5, s.wave(uv, 34.0, 0.6), s.wave(uv, 34.0, 0.6, "Y"), "MULTIPLY")
    col = s.speckle(s.mix(0.3, col, weave, "MULTIPLY"), uv, 60.0, 0.4)
    return s.finish(col, weave, 0.4, 0.003)


def wicker(name):
    s = Shader(name, 0.7, 0.2)
    uv = s.coords((1, 1, 1), "UV")
    weft = s.node("TexBrick", {"Vector": uv, "Color1": (0.52, 0.32, 0.13), "Color2": (0.34, 0.18, 0.06),
                               "Mortar": (0.07, 0.035, 0.012), "Scale": 1.0, "Mortar Size": 0.007,
                               "Mortar Smooth": 0.6, "Brick Width": 0.05, "Row Height": 0.085})
    return s.finish(s.speckle(weft, s.coords(), 75.0, 0.5), weft, 0.8, 0.01)


def fruit_skin(name, low, mid, high, spots, rough=0.4):
    """Streaks from pole to pole over a blotchy ground, with pores."""
    s = Shader(name, rough, 0.35)
    vec = s.coords(vary=True)
    streak = s.noise(s.coords((60, 60, 6), vary=True), 1.2, 4.0, 0.6)
    ground = s.noise(vec, 11.0, 4.0)
    col = s.ramp(s.mix(0.5, streak, ground), (0.34, low), (0.5, mid), (0.66, high))
    pores = s.ramp(s.voronoi(vec, 95.0), (0.12, 1.0), (0.25, 0.0))
    col = s.mix(s.math("MULTIPLY", pores, 0.6), col, spots)
    return s.finish(s.speckle(col, vec, 60.0, 0.3), s.noise(vec, 120.0), 0.25, 0.002)


def crust(name):
    s = Shader(name, 0.85, 0.15)
    vec = s.coords()
    col = s.ramp(s.noise(vec, 16.0, 4.0, 0.7), (0.3, (0.20, 0.07, 0.02)), (0.48, (0.48, 0.22, 0.07)),
                 (0.6, (0.66, 0.40, 0.17)), (0.72, (0.86, 0.74, 0.55)))
    slash = s.ramp(s.wave(vec, 5.5, 1.5), (0.0, 1.0), (0.16, 0.0))
    col = s.mix(slash, col, s.speckle((0.84, 0.68, 0.44), vec, 70.0, 0.5))
    return s.finish(s.speckle(col, vec, 70.0, 0.4), s.noise(vec, 40.0, 3.0), 0.6, 0.008)


def soil(name):
    s = Shader(name, 1.0, 0.0)
    vec = s.coords(vary=True)
    cell = s.node("SeparateColor", {0: s.voronoi(vec, 65.0, out="Color")}, out=0)
    col = s.ramp(cell, (0.0, (0.02, 0.012, 0.008)), (0.8, (0.09, 0.055, 0.03)), (1.0, (0.35, 0.28, 0.2)))
    return s.finish(col, s.voronoi(vec, 65.0), 0.8, 0.01)


def book_cover(name, base, second):
    s = Shader(name, 0.7, 0.25)
    vec = s.coords()
    worn = s.noise(vec, 14.0, 4.0, 0.72)
    col = s.mix(s.ramp(worn, (0.56, 0.0), (0.62, 0.8)), base, second)
    return s.finish(s.speckle(col, vec, 60.0, 0.45), worn, 0.2, 0.003)


def pages(name):
    s = Shader(name, 0.95, 0.05)
    lines = s.noise(s.coords((6, 6, 330)), 1.0, 3.0, 0.7)
    return s.finish(s.ramp(lines, (0.3, (0.35, 0.26, 0.15)), (0.6, (0.80, 0.72, 0.56))), lines, 0.4, 0.003)


def log_end(name):
    s = Shader(name, 0.9, 0.1)
    vec = s.coords(vary=False)
    rings = s.wave(vec, 16.0, 2.2, "Z", 3.0, 2.0, kind="RINGS")
    col = s.ramp(rings, (0.0, (0.36, 0.20, 0.09)), (0.6, (0.66, 0.46, 0.25)), (1.0, (0.78, 0.60, 0.37)))
    tint = s.ramp(s.node("ObjectInfo", out="Random"), (0.0, 0.5), (1.0, 1.0))
    col = s.mix(1.0, col, tint, "MULTIPLY")
    return s.finish(s.speckle(col, s.coords(vary=True), 42.0, 0.6), rings, 0.4, 0.004)


def bark(name):
    s = Shader(name, 0.95, 0.05)
    vec = s.coords((26, 26, 7), vary=True)
    v = s.noise(vec, 1.5, 4.0, 0.7, 1.0)
    return s.finish(s.ramp(v, (0.35, (0.05, 0.03, 0.02)), (0.6, (0.26, 0.19, 0.13)), (0.75, (0.45, 0.38, 0.3))),
                    v, 0.9, 0.015)


def plain(name, color, scale=45.0, amount=0.4, roughness=0.7):
    """A paint of one color with fine wear; for text, iron, frames."""
    s = Shader(name, roughness, 0.3)
    vec = s.coords(vary=True)
    return s.finish(s.speckle(s.speckle(color, vec, scale, amount), vec, 9.0, 0.25),
                    s.noise(vec, scale), 0.2, 0.003)


# ---------------------------------------------------------------- geometry helpers
def link(obj):
    bpy.context.scene.collection.objects.link(obj)
    return obj


def mesh_object(name, verts, faces, mat, uvs=None, smooth=True):
    """`uvs` has one pair per vertex; faces copy them to their corners."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(verts, [], faces)
    if uvs:
        layer = mesh.uv_layers.new()
        for loop in mesh.loops:
            layer.data[loop.index].uv = uvs[loop.vertex_index]
    mesh.materials.append(mat)
    mesh.polygons.foreach_set("use_smooth", [smooth] * len(mesh.polygons))
    mesh.validate()
    return link(bpy.data.objects.new(name, mesh))


def box(name, size, loc, mat, rot=(0, 0, 0), bevel=0.004):
    """A bevelled box; its size lives in the mesh, so object coordinates stay in meters."""
    x, y, z = (c / 2 for c in size)
    verts = [(sx * x, sy * y, sz * z) for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    obj = mesh_object(name, verts, faces, mat, smooth=False)
    obj.location, obj.rotation_euler = loc, rot
    if bevel:
        mod = obj.modifiers.new("bevel", "BEVEL")
        mod.width, mod.segments = bevel, 3
    return obj


def resample(profile, steps):
    """Catmull-Rom through the profile's points, so that few numbers give a smooth shape."""
    pts = [Vector((*p, 0)) for p in profile]
    pts = [2 * pts[0] - pts[1]] + pts + [2 * pts[-1] - pts[-2]]
    out = []
    for i in range(1, len(pts) - 2):
        a, b, c, d = pts[i - 1:i + 3]
        for k in range(steps):
            t = k / steps
            q = 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t * t
                       + (3 * b - a - 3 * c + d) * t ** 3)
            out.append((max(q.x, 0.0), q.y))
    return out + [(pts[-2].x, pts[-2].y)]


def lathe(name, profile, loc, mat, smooth_steps=5, sides=56, lumps=0.0):
    """Turn a profile of (radius, height) about z; `lumps` makes it a little irregular."""
    ring = resample(profile, smooth_steps) if smooth_steps else profile
    verts, uvs, faces = [], [], []
    seed = Vector((RNG.uniform(0, 50), 0, 0))
    for j, (r, z) in enumerate(ring):
        for i in range(sides + 1):          # the seam is doubled so that u can run to 1
            a = 2 * math.pi * (i % sides) / sides
            p = Vector((r * math.cos(a), r * math.sin(a), z))
            if lumps:
                p += p * (lumps * noise.noise(p * 18 + seed))
            verts.append(p)
            uvs.append((i / sides, j / (len(ring) - 1)))
    for j in range(len(ring) - 1):
        for i in range(sides):
            a = j * (sides + 1) + i
            faces.append((a, a + 1, a + sides + 2, a + sides + 1))
    obj = mesh_object(name, verts, faces, mat, uvs)
    obj.location = loc
    return obj


def tube(name, points, radii, mat):
    """A round rod through `points` (a spline with a radius at each)."""
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions, curve.bevel_depth, curve.bevel_resolution = "3D", 1.0, 4
    curve.use_fill_caps = True
    spline = curve.splines.new("NURBS")
    spline.points.add(len(points) - 1)
    spline.use_endpoint_u, spline.order_u = True, min(4, len(points))
    for sp, p, r in zip(spline.points, points, radii):
        sp.co, sp.radius = (*p, 1.0), r
    curve.materials.append(mat)
    return link(bpy.data.objects.new(name, curve))


def text(body, size, loc, rot, mat, parent=None):
    curve = bpy.data.curves.new(body, "FONT")
    curve.body, curve.size, curve.extrude = body, size, 0.0008
    curve.align_x, curve.align_y = "CENTER", "CENTER"
    curve.materials.append(mat)
    obj = link(bpy.data.objects.new(body, curve))
    obj.location, obj.rotation_euler, obj.parent = loc, rot, parent
    return obj


class Leaves:
    """Collects many leaves into one mesh (one object renders faster than thousands)."""

    def __init__(self, width=0.32, lobes=0.0):
        self.width, self.lobes = width, lobes
        self.verts, self.faces, self.uvs = [], [], []

    def add(self, loc, direction, up, size, curl=0.25):
        y = Vector(direction).normalized()
        x = y.cross(Vector(up))
        if x.length < 1e-3:
            x = y.cross(Vector((0.3, 0.5, 0.8)))
        x.normalize()
        frame = Matrix((x, y, x.cross(y))).transposed()
        base, n = len(self.verts), 6
        for k in range(n + 1):
            t = k / n
            half = self.width * math.sin(math.pi * min(1.0, t * 0.92 + 0.06)) ** 0.8
            half *= 1.0 + self.lobes * math.cos(5 * math.pi * t)
            half = 0.004 if k == n else half
            drop = -curl * t * t
            for side in (-1, 0, 1):
                p = Vector((side * half, t, drop + abs(side) * half * 0.45))
                self.verts.append(Vector(loc) + frame @ (p * size))
                self.uvs.append((0.5 + side / 2, t))
        for k in range(n):
            for c in (0, 1):
                a = base + 3 * k + c
                self.faces.append((a, a + 1, a + 4, a + 3))

    def build(self, name, mat):
        return mesh_object(name, self.verts, self.faces, mat, self.uvs)


def random_unit():
    while True:
        v = Vector([RNG.uniform(-1, 1) for _ in range(3)])
        if 0.1 < v.length < 1:
            return v.normalized()


# ---------------------------------------------------------------- the courtyard
def build_floor_and_walls(m):
    paving = rubble("paving", 2.3, [(0.28, 0.24, 0.19), (0.42, 0.36, 0.28), (0.22, 0.21, 0.20),
                                    (0.50, 0.42, 0.31)], (0.12, 0.10, 0.07), flat=True)
    stone = rubble("stone wall", 4.6, [(0.36, 0.31, 0.24), (0.52, 0.45, 0.34), (0.26, 0.24, 0.22),
                                       (0.44, 0.34, 0.22)], (0.20, 0.17, 0.13), (1, 1.55, 1))
    red = bricks("red brick", (0.40, 0.13, 0.07), (0.22, 0.08, 0.05), (0.40, 0.35, 0.28))
    limed = bricks("limed brick", (0.38, 0.15, 0.09), (0.26, 0.12, 0.08), (0.45, 0.41, 0.35),
                   lime=(0.74, 0.72, 0.66))
    box("floor", (2 * HALF_X + 0.4, 2 * HALF_Y + 0.4, 0.2), (0, 0, -0.1), paving, bevel=0)
    # Wall meshes lie in their local xy plane (x along, y up): brick texture works in xy.
    h, t = 2.7, 0.2
    up = math.pi / 2
    box("north", (2 * HALF_X, h, t), (0, HALF_Y + t / 2, h / 2), red, (up, 0, 0), 0)
    box("south", (2 * HALF_X, h, t), (0, -HALF_Y - t / 2, h / 2), stone, (up, 0, math.pi), 0)
    box("east", (2 * HALF_Y, h, t), (HALF_X + t / 2, 0, h / 2), plaster("plaster"), (up, 0, -up), 0)
    box("west", (2 * HALF_Y, h, t), (-HALF_X - t / 2, 0, h / 2), limed, (up, 0, up), 0)


def build_door(m):
    """Plank door in the south wall, with iron straps and a stone lintel."""
    y = -HALF_Y + 0.03
    for i in range(6):
        box("door plank", (2.05, 0.148, 0.05), (-0.9 + 0.155 * i, y, 1.03), m["paint green"],
            (0, -math.pi / 2, 0), 0.006).rotation_euler = Euler((0, -math.pi / 2, math.pi / 2))
    for z in (0.45, 1.6):
        box("strap", (0.86, 0.02, 0.055), (-0.53, y + 0.035, z), m["iron"])
    box("lintel", (1.3, 0.14, 0.2), (-0.51, y, 2.17), m["oak"], bevel=0.015)
    for x in (-1.05, 0.03):
        box("jamb", (2.06, 0.14, 0.12), (x, y, 1.03), m["oak"], (0, math.pi / 2, 0), 0.012)
    tube("ring", [(-0.17 + 0.05 * math.cos(a), y + 0.05, 1.05 + 0.05 * math.sin(a))
                  for a in [k * math.pi / 4 for k in range(9)]], [0.008] * 9, m["iron"])


def build_window(m):
    """Closed louvred shutters and a flower box on the east wall."""
    x = HALF_X - 0.03
    for side in (-1, 1):
        cy = 0.3 + side * 0.27
        for dy in (-0.24, 0.24):
            box("stile", (1.15, 0.055, 0.045), (x, cy + dy, 1.45), m["paint blue"], (0, math.pi / 2, 0))
        for z in (0.9, 1.45, 2.0):
            box("rail", (0.045, 0.44, 0.07), (x, cy, z), m["paint blue"])
        for k in range(20):
            z = 0.96 + 0.052 * k
            if abs(z - 1.45) > 0.05:
                box("louvre", (0.43, 0.05, 0.009), (x, cy, z), m["paint blue"],
                    (0.6, 0, math.pi / 2), 0.002)
    box("sill", (0.2, 1.3, 0.07), (x - 0.05, 0.3, 0.83), m["oak"], bevel=0.012)
    box("window lintel", (0.12, 1.35, 0.16), (x, 0.3, 2.12), m["oak"], bevel=0.012)
    box("flower box", (0.9, 0.18, 0.16), (x - 0.09, 0.3, 0.94), m["crate"], (0, 0, math.pi / 2), 0.006)
    bush((x - 0.10, 0.3, 1.06), (0.12, 0.45, 0.12), 420, 0.075, m["leaf mid"])
    petals = Leaves(0.5)
    for _ in range(46):
        p = Vector((x - 0.13 + RNG.uniform(-0.1, 0.08), 0.3 + RNG.uniform(-0.43, 0.43), 1.1 + RNG.uniform(-0.05, 0.11)))
        blossom(petals, p, Vector((-0.8, RNG.uniform(-0.5, 0.5), 0.6)), 0.035, 6)
    petals.build("geranium", m["petal red"])


def build_sign(m):
    """A framed herb picture and an enamel sign on the limed west wall."""
    x = -HALF_X + 0.02
    board = box("sign", (0.03, 0.92, 0.34), (x, -0.35, 1.72), m["enamel"], bevel=0.01)
    side = (math.pi / 2, 0, math.pi / 2)
    text("JARDIN", 0.19, (0.018, 0, 0.05), side, m["cream"], board)
    text("- herbs & honey -", 0.085, (0.018, 0, -0.095), side, m["cream"], board)
    box("picture", (0.02, 0.5, 0.66), (x, 0.62, 1.55), m["paper"], bevel=0)
    for dy, dz, w, h in ((-0.27, 0, 0.06, 0.78), (0.27, 0, 0.06, 0.78), (0, 0.36, 0.6, 0.06), (0, -0.36, 0.6, 0.06)):
        box("frame", (0.05, w, h), (x + 0.01, 0.62 + dy, 1.55 + dz), m["oak"], bevel=0.008)
    herb = Leaves(0.26)
    for k in range(13):
        z = 1.30 + 0.036 * k
        for s in (-1, 1):
            herb.add((x + 0.014, 0.62 + 0.015 * s, z), (0, s, 0.75), (1, 0, 0), 0.19 - 0.009 * k, 0)
    herb.build("pressed herb", m["leaf dark"])
    text("Ocimum", 0.07, (x + 0.013, 0.62, 1.265), side, m["iron"])


def build_logs(m):
    """Firewood stacked along the west wall, ends towards the table."""
    y0, r0 = -1.9, 0.068
    for row in range(8):
        count = 17 - (row % 2)
        for k in range(count):
            if row > 4 and k > 15 - 2 * (row - 4) + RNG.choice((0, 1)):
                continue
            r = r0 * RNG.uniform(0.86, 1.0)
            y = y0 + 2 * r0 * (k + 0.5 * (row % 2))
            z = r0 + row * r0 * 1.74
            x = -HALF_X + 0.22 + RNG.uniform(-0.03, 0.03)
            turn = (0, math.pi / 2, 0)
            ring = [(r * 0.999, -0.2), (r, -0.19), (r, 0.19), (r * 0.97, 0.2)]
            body = lathe("log", ring, (x, y, z), m["bark"], 0, 18, 0.08)
            end = lathe("log end", [(0.0, 0.2), (r * 0.5, 0.2), (r * 0.95, 0.199)], (x + 0.001, y, z), m["log end"], 0, 18)
            body.rotation_euler = end.rotation_euler = turn


def bush(loc, radii, count, size, mat, lobes=0.0, width=0.34):
    """Leaves on and in an ellipsoid, pointing outwards and drooping."""
    cloud = Leaves(width, lobes)
    for _ in range(count):
        d = random_unit()
        depth = RNG.uniform(0.55, 1.0)
        p = Vector(loc) + Vector((d.x * radii[0], d.y * radii[1], d.z * radii[2])) * depth
        out = d + 0.5 * random_unit() + Vector((0, 0, 0.25))
        cloud.add(p, out, d + Vector((0, 0, 0.8)) + 0.4 * random_unit(), size * RNG.uniform(0.6, 1.15), RNG.uniform(0.1, 0.5))
    return cloud.build("bush", mat)


def blossom(petals, loc, normal, size, count=9):
    normal = normal.normalized()
    side = normal.orthogonal().normalized()
    start = RNG.uniform(0, math.pi)
    for k in range(count):
        a = start + 2 * math.pi * k / count
        d = Matrix.Rotation(a, 3, normal) @ side
        petals.add(loc, d + 0.25 * normal, normal, size, 0.15)


def pot(loc, r, h, m, wall=0.012):
    """Terracotta pot with a rim, filled with soil."""
    prof = [(0.0, 0.0), (r * 0.68, 0.0), (r * 0.7, 0.004), (r * 0.9, h * 0.78), (r * 0.91, h * 0.79),
            (r * 1.02, h * 0.80), (r * 1.04, h * 0.985), (r * 1.02, h), (r * 1.02 - wall, h),
            (r * 0.9, h * 0.86)]
    lathe("pot", prof, loc, m["terracotta"], 0, 56, 0.006)
    lathe("soil", [(0.0, h * 0.9), (r * 0.5, h * 0.895), (r * 0.93, h * 0.87)], loc, m["soil"], 2)


def build_ivy(m):
    """Ivy creeping up the red brick wall; a random walk per stem."""
    leaves, y = Leaves(0.46, 0.12), HALF_Y - 0.02
    for x0 in (-2.6, -2.3, -1.9, -1.5, -0.7, 1.0, 1.6, 2.0, 2.35, 2.6):
        x, z, drift = x0, 0.0, RNG.uniform(-0.3, 0.3)
        top = RNG.uniform(1.3, 2.6)
        path = []
        while z < top:
            path.append((x, y, z))
            for _ in range(4):
                p = Vector((x + RNG.gauss(0, 0.085), y - RNG.uniform(0.0, 0.05), z + RNG.gauss(0, 0.05)))
                leaves.add(p, (RNG.gauss(0, 0.6), -0.25, -0.6 + RNG.gauss(0, 0.3)),
                           (RNG.gauss(0, 0.3), -1, 0.35), RNG.uniform(0.06, 0.125), 0.15)
            drift = 0.8 * drift + RNG.uniform(-0.25, 0.25)
            x, z = x + 0.06 * drift, z + 0.065
        tube("ivy stem", path, [0.008] * len(path), m["bark"])
    leaves.build("ivy", m["leaf dark"])


def build_floor_items(m):
    for x, y, r, h, size, mat in ((2.3, 2.05, 0.26, 0.42, 0.15, "leaf mid"), (2.35, -2.1, 0.28, 0.36, 0.13, "leaf dark"),
                                  (-2.3, 2.1, 0.24, 0.45, 0.17, "leaf light"), (1.55, 2.25, 0.17, 0.25, 0.09, "leaf light"),
                                  (2.45, -1.35, 0.17, 0.28, 0.10, "leaf light"), (2.42, 1.35, 0.16, 0.24, 0.08, "leaf dark")):
        pot((x, y, 0), r, h, m)
        bush((x, y, h + r * 1.15), (r * 1.2, r * 1.2, r * 1.4), int(340 + 900 * r), size, m[mat])
    build_crates(m)
    litter = Leaves(0.36)
    for _ in range(170):
        x, y = RNG.uniform(-2.6, 2.6), RNG.uniform(-2.4, 2.4)
        a = RNG.uniform(0, 2 * math.pi)
        litter.add((x, y, 0.012), (math.cos(a), math.sin(a), 0.05), (RNG.gauss(0, 0.2), RNG.gauss(0, 0.2), 1), RNG.uniform(0.05, 0.10), 0.1)
    litter.build("fallen leaves", m["leaf autumn"])


def build_crates(m):
    """Two slatted crates of apples beside the door."""
    for cx, cy, z0, turn in ((0.75, -2.25, 0, 0.1), (1.45, -2.2, 0, -0.15), (1.1, -2.28, 0.33, 0.05)):
        rot = Matrix.Rotation(turn, 3, "Z")
        def at(x, y, z):
            v = rot @ Vector((x, y, z))
            return (cx + v.x, cy + v.y, z0 + z)
        for k in range(3):
            z = 0.06 + 0.1 * k
            for s in (-1, 1):
                box("slat", (0.6, 0.014, 0.08), at(0, s * 0.18, z), m["crate"], (0, 0, turn))
                box("slat", (0.36, 0.014, 0.08), at(s * 0.3, 0, z), m["crate"], (0, 0, turn + math.pi / 2))
        for sx in (-1, 1):
            for sy in (-1, 1):
                box("post", (0.3, 0.03, 0.03), at(sx * 0.28, sy * 0.16, 0.155), m["crate"], (0, math.pi / 2, turn))
        box("bottom", (0.58, 0.35, 0.015), at(0, 0, 0.02), m["crate"], (0, 0, turn))
        if z0 or cx > 1.3:
            for i in range(7):
                for j in range(4):
                    apple(at(-0.24 + 0.08 * i + RNG.uniform(-.008, .008), -0.12 + 0.08 * j, 0.25 + RNG.uniform(-.01, .02)), 0.041, m["apple"])


# ---------------------------------------------------------------- the still life
def build_table(m):
    for i in range(6):
        box("plank", (1.56 + RNG.uniform(-0.008, 0.008), 0.148, 0.036), (0, -0.375 + 0.15 * i, TABLE_Z - 0.018 + RNG.uniform(-.0008, .0008)),
            m["table"], bevel=0.006)
    for x in (-0.66, 0.66):
        for y in (-0.36, 0.36):
            box("leg", (0.714, 0.075, 0.075), (x, y, 0.357), m["table"], (0, math.pi / 2, 0), 0.008)
        box("rail", (0.72, 0.03, 0.09), (x, 0, 0.665), m["table"], (0, 0, math.pi / 2))
    for y in (-0.36, 0.36):
        box("rail", (1.3, 0.03, 0.09), (0, y, 0.665), m["table"])
    box("stretcher", (1.3, 0.07, 0.05), (0, 0, 0.2), m["table"])


def build_runner(m):
    """Cloth across the table, hanging over both long edges in soft folds."""
    width, reach, drop, n, k = 0.52, 0.456, 0.30, 130, 60
    total = 2 * (reach + drop)
    verts, uvs, faces = [], [], []
    for j in range(n + 1):
        s = -total / 2 + total * j / n                    # arc length from the middle
        over = max(0.0, abs(s) - reach)
        for i in range(k + 1):
            u = -width / 2 + width * i / k
            fold = min(1.0, over / drop) * 0.03 * math.sin(u * 21 + 2.2 * math.copysign(1, s))
            wrinkle = 0.004 * max(0.0, noise.noise(Vector((u * 7, s * 7, 3)))) + 0.003
            bend = min(over, 0.03)                        # round the table's edge
            y = math.copysign(min(abs(s), reach) + bend * 0.55 + 0.012 * (over > 0.03) + (fold + 0.03 * (over / drop)) * (over > 0), s)
            verts.append((u * (1 + 0.04 * over / drop), y, TABLE_Z + wrinkle - max(0.0, over - 0.012)))
            uvs.append((u, s))
    for j in range(n):
        for i in range(k):
            a = j * (k + 1) + i
            faces.append((a, a + 1, a + k + 2, a + k + 1))
    obj = mesh_object("runner", verts, faces, m["cloth"], uvs)
    obj.rotation_euler = (0, 0, 0)
    obj.location = (-0.06, 0, 0)
    obj.modifiers.new("thick", "SOLIDIFY").thickness = 0.0025


def apple(loc, r, mat):
    prof = [(0.0, -0.72), (0.25, -0.86), (0.62, -0.72), (0.94, -0.15), (1.0, 0.25), (0.78, 0.75), (0.42, 0.9), (0.12, 0.72), (0.0, 0.62)]
    obj = lathe("apple", [(r * a, r * b) for a, b in prof], loc, mat, 4, 32, 0.05)
    obj.rotation_euler = (RNG.uniform(-0.5, 0.5), RNG.uniform(-0.5, 0.5), RNG.uniform(0, 6))
    return obj


def ball(name, loc, r, mat, longer=1.0, nub=0.0):
    """Orange (round) or lemon (longer, with nubs)."""
    prof = [(math.cos(a), math.sin(a) * longer) for a in [(-0.5 + k / 12) * math.pi for k in range(13)]]
    prof[0] = (0.0, prof[0][1] - nub)
    prof[-1] = (0.0, prof[-1][1] + nub)
    obj = lathe(name, [(r * max(a, 0), r * b) for a, b in prof], loc, mat, 3, 32, 0.035)
    obj.rotation_euler = [RNG.uniform(0, 6) for _ in range(3)]
    return obj


def pear(loc, r, mat, rot):
    prof = [(0.0, -0.95), (0.5, -0.92), (0.92, -0.45), (1.0, 0.0), (0.8, 0.6), (0.52, 1.1), (0.4, 1.5), (0.2, 1.72), (0.0, 1.72)]
    obj = lathe("pear", [(r * a, r * b) for a, b in prof], loc, mat, 4, 32, 0.05)
    obj.rotation_euler = rot
    return obj


def build_fruit_basket(m, x, y):
    z = TABLE_Z + 0.006
    prof = [(0.0, 0.006), (0.10, 0.0), (0.125, 0.01), (0.165, 0.06), (0.188, 0.11), (0.197, 0.115), (0.190, 0.12), (0.178, 0.11), (0.15, 0.06), (0.1, 0.02), (0.0, 0.018)]
    lathe("basket", prof, (x, y, z), m["wicker"], 4, 72)
    rim = [(x + 0.192 * math.cos(a), y + 0.192 * math.sin(a), z + 0.118 + 0.004 * math.sin(14 * a)) for a in [k * math.pi / 40 for k in range(81)]]
    tube("basket rim", rim, [0.010] * len(rim), m["wicker rim"])
    spots = [("apple", 0.10, 0.2), ("orange", 0.10, 1.3), ("apple", 0.095, 2.4), ("lemon", 0.10, 3.35), ("orange", 0.10, 4.3), ("apple", 0.10, 5.3)]
    for kind, d, a in spots:
        fruit(kind, (x + d * math.cos(a), y + d * math.sin(a), z + 0.10), m)
    fruit("orange", (x, y, z + 0.075), m)
    fruit("apple", (x + 0.045, y + 0.03, z + 0.163), m)
    fruit("lemon", (x - 0.055, y + 0.025, z + 0.16), m)
    pear((x + 0.0, y - 0.06, z + 0.165), 0.038, m["pear"], (1.1, 0.2, 0.5))


def fruit(kind, loc, m):
    if kind == "apple":
        apple(loc, 0.043, m["apple"])
    elif kind == "orange":
        ball("orange", loc, 0.044, m["orange"])
    else:
        ball("lemon", loc, 0.032, m["lemon"], 1.25, 0.22)


def build_teapot(m, x, y, turn):
    """The one modestly glossy thing on the table: blue-and-white glazed pottery."""
    z = TABLE_Z + 0.001
    body = [(0.0, 0.0), (0.062, 0.0), (0.068, 0.008), (0.098, 0.045), (0.108, 0.085), (0.095, 0.13), (0.06, 0.158), (0.052, 0.163)]
    lathe("teapot", body, (x, y, z), m["glaze"], 5, 72)
    lid = [(0.058, 0.160), (0.056, 0.168), (0.035, 0.182), (0.012, 0.19), (0.010, 0.197), (0.020, 0.208), (0.014, 0.22), (0.0, 0.224)]
    lathe("lid", lid, (x, y, z), m["glaze lid"], 5, 48)
    rot = Matrix.Rotation(turn, 3, "Z")
    def bent(points):
        return [tuple(Vector((x, y, z)) + rot @ Vector((a, 0, b))) for a, b in points]
    tube("spout", bent([(0.07, 0.055), (0.12, 0.062), (0.145, 0.10), (0.16, 0.145), (0.185, 0.165)]), [0.030, 0.026, 0.018, 0.013, 0.012], m["blue"])
    tube("handle", bent([(-0.085, 0.13), (-0.14, 0.155), (-0.18, 0.12), (-0.17, 0.065), (-0.13, 0.04), (-0.095, 0.045)]), [0.010, 0.011, 0.011, 0.010, 0.010, 0.010], m["blue"])


def build_cup(m, x, y, turn):
    z = TABLE_Z + 0.004
    lathe("saucer", [(0.0, 0.004), (0.04, 0.0), (0.05, 0.004), (0.078, 0.016), (0.076, 0.02), (0.045, 0.01), (0.0, 0.009)], (x, y, z), m["glaze small"], 4)
    cup = [(0.0, 0.01), (0.024, 0.01), (0.03, 0.016), (0.042, 0.045), (0.046, 0.072), (0.043, 0.073), (0.04, 0.05), (0.026, 0.02), (0.0, 0.018)]
    lathe("cup", cup, (x, y, z), m["glaze small"], 4)
    lathe("tea", [(0.0, 0.058), (0.0405, 0.058)], (x, y, z), m["tea"], 0)
    c, s = math.cos(turn), math.sin(turn)
    tube("cup handle", [(x + c * a, y + s * a, z + b) for a, b in ((0.04, 0.062), (0.07, 0.066), (0.074, 0.042), (0.055, 0.027), (0.035, 0.03))], [0.0045] * 5, m["blue"])


def book(size, loc, turn, cover, title, m, accent):
    """Covers, spine and a recessed block of pages; returns its top height."""
    w, d, h = size
    root = box("pages", (w - 0.012, d - 0.014, h - 0.008), (loc[0], loc[1], loc[2] + h / 2), m["pages"], (0, 0, turn), 0)
    for s in (-1, 1):
        box("cover", (w, d, 0.005), (0, 0, s * (h / 2 - 0.0025)), cover, bevel=0.002).parent = root
    box("spine", (w, 0.006, h), (0, -d / 2 + 0.002, 0), cover, bevel=0.0025).parent = root
    text(title, min(h * 0.55, 0.03), (0, -d / 2 - 0.0012, 0), (math.pi / 2, 0, 0), accent, root)
    return root, loc[2] + h + 0.0005


def build_books(m, x, y):
    z = TABLE_Z + 0.001
    _, z = book((0.30, 0.215, 0.045), (x, y, z), 0.35, m["cover green"], "A GARDEN YEAR", m, m["gold"])
    _, z = book((0.26, 0.19, 0.036), (x + 0.01, y + 0.005, z), 0.1, m["cover red"], "STONES & GEMS", m, m["cream"])
    top, z = book((0.235, 0.165, 0.040), (x - 0.005, y, z), 0.52, m["cover blue"], "LIGHT AND FIELD", m, m["gold"])
    for dy in (-0.07, 0.07):
        box("rule", (0.2, 0.004, 0.001), (0, dy, 0.0204), m["gold"], bevel=0).parent = top
    text("LIGHT", 0.052, (0, 0.032, 0.0205), (0, 0, 0), m["gold"], top)
    text("& FIELD", 0.042, (0, -0.018, 0.0205), (0, 0, 0), m["gold"], top)
    tube("ribbon", [(x + 0.10, y - 0.03, TABLE_Z + 0.06), (x + 0.17, y - 0.05, TABLE_Z + 0.055), (x + 0.19, y - 0.06, TABLE_Z + 0.005), (x + 0.23, y - 0.09, TABLE_Z + 0.004)], [0.003] * 4, m["petal red"])


def build_board(m, x, y, turn):
    """Chopping board with a loaf, two slices and a knife-less breakfast."""
    box("board", (0.40, 0.22, 0.022), (x, y, TABLE_Z + 0.012), m["board"], (0, 0, turn), 0.008)
    rot = Matrix.Rotation(turn, 3, "Z")
    def at(a, b, c):
        v = rot @ Vector((a, b, 0))
        return (x + v.x, y + v.y, TABLE_Z + 0.023 + c)
    prof = [(0.0, -0.125), (0.022, -0.12), (0.046, -0.095), (0.06, -0.04), (0.061, 0.03), (0.05, 0.09), (0.024, 0.118), (0.0, 0.124)]
    loaf = lathe("loaf", prof, at(-0.055, 0.01, 0.043), m["crust"], 5, 48, 0.13)
    loaf.rotation_euler = (0, math.pi / 2, turn)
    loaf.scale = (0.85, 1.0, 1.0)
    for k, tilt in ((0, 0.25), (1, 0.1)):
        piece = lathe("slice", [(0.0, -0.009), (0.05, -0.009), (0.055, -0.006), (0.055, 0.006), (0.05, 0.009), (0.0, 0.009)], at(0.125 + 0.012 * k, 0.0, 0.012 + 0.019 * k), m["crumb"], 0, 32, 0.15)
        piece.rotation_euler = (0.04, tilt * 0.3, turn + k)


def build_vase(m, x, y):
    """Stoneware vase with daisies and greenery."""
    z = TABLE_Z + 0.001
    lathe("vase", [(0.0, 0.0), (0.048, 0.0), (0.052, 0.006), (0.076, 0.06), (0.078, 0.10), (0.055, 0.155), (0.038, 0.185), (0.05, 0.215), (0.046, 0.217), (0.034, 0.19), (0.0, 0.17)], (x, y, z), m["stoneware"], 5, 64)
    petals, yellow, green = Leaves(0.20), Leaves(0.24), Leaves(0.22)
    for k in range(15):
        a, lean = 2.399 * k, 0.03 + 0.115 * math.sqrt((k + 0.5) / 15)
        tip = Vector((x + lean * math.cos(a), y + lean * math.sin(a), z + 0.40 - 1.1 * lean + RNG.uniform(-0.02, 0.03)))
        foot = Vector((x + 0.018 * math.cos(a), y + 0.018 * math.sin(a), z + 0.2))
        middle = (foot + tip) / 2 + Vector((0, 0, 0.02))
        tube("stem", [foot, middle, tip], [0.003] * 3, m["stalk"])
        normal = Vector((lean * 5 * math.cos(a), lean * 5 * math.sin(a), 0.75))
        blossom(yellow if k % 3 == 0 else petals, tip, normal, RNG.uniform(0.036, 0.046), 13)
        eye = lathe("eye", [(0.012, -0.004), (0.012, 0.002), (0.007, 0.007), (0.0, 0.008)], tip, m["eye brown" if k % 3 == 0 else "eye"], 2, 16)
        eye.rotation_euler = normal.to_track_quat("Z", "Y").to_euler()
        for _ in range(3):
            d = random_unit()
            green.add(middle + 0.012 * d, Vector((math.cos(a), math.sin(a), 0.7)) + 0.5 * d, (0, 0, 1), RNG.uniform(0.06, 0.1), 0.4)
    petals.build("daisies", m["petal white"])
    yellow.build("rudbeckia", m["petal yellow"])
    green.build("greens", m["leaf mid"])


def build_basil(m, x, y):
    lathe("dish", [(0.0, 0.003), (0.075, 0.0), (0.092, 0.02), (0.088, 0.021), (0.07, 0.008), (0.0, 0.007)], (x, y, TABLE_Z + 0.001), m["terracotta"], 3)
    pot((x, y, TABLE_Z + 0.009), 0.078, 0.12, m, 0.007)
    bush((x, y, TABLE_Z + 0.195), (0.088, 0.088, 0.08), 210, 0.052, m["leaf light"], width=0.36)


def scatter_table(m):
    """Loose things: lemons, apples, walnuts and a few leaves."""
    ball("lemon", (0.30, -0.30, TABLE_Z + 0.033), 0.032, m["lemon"], 1.25, 0.22).rotation_euler = (1.57, 0.2, 0.5)
    apple((-0.13, -0.34, TABLE_Z + 0.042), 0.041, m["apple"])
    apple((0.20, 0.32, TABLE_Z + 0.040), 0.041, m["apple"])
    for px, py in ((-0.60, -0.05), (-0.65, -0.015), (-0.585, 0.005), (0.66, -0.02), (0.63, 0.03), (0.14, -0.38)):
        ball("walnut", (px, py, TABLE_Z + 0.018), 0.018, m["walnut"], 1.15, 0.1)
    fallen = Leaves(0.36)
    for px, py in ((-0.5, 0.38), (-0.68, 0.16), (0.1, -0.28), (0.62, 0.33), (0.33, 0.40), (-0.62, -0.35)):
        a = RNG.uniform(0, 6)
        fallen.add((px, py, TABLE_Z + 0.008), (math.cos(a), math.sin(a), 0.1), (0, 0, 1), 0.07, 0.2)
    fallen.build("table leaves", m["leaf autumn"])


def build_still_life(m):
    build_table(m)
    build_runner(m)
    build_fruit_basket(m, -0.05, -0.02)
    build_teapot(m, -0.50, -0.16, 3.9)
    build_cup(m, -0.33, -0.33, 4.4)
    build_basil(m, -0.52, 0.22)
    build_vase(m, 0.06, 0.27)
    build_books(m, 0.45, 0.17)
    build_board(m, 0.46, -0.20, 0.22)
    scatter_table(m)


# ---------------------------------------------------------------- materials of the set
def make_materials():
    white, navy = (0.80, 0.78, 0.72), (0.03, 0.07, 0.26)
    return {
        "table": wood("table", (0.13, 0.065, 0.03), (0.46, 0.29, 0.16)),
        "oak": wood("oak", (0.10, 0.065, 0.04), (0.33, 0.23, 0.14)),
        "crate": wood("crate", (0.26, 0.18, 0.10), (0.62, 0.48, 0.31)),
        "board": wood("board", (0.32, 0.17, 0.07), (0.68, 0.46, 0.25), (2, 22, 22)),
        "paint green": wood("paint green", (0.14, 0.10, 0.06), (0.36, 0.27, 0.17), wear=(0.10, 0.22, 0.15)),
        "paint blue": wood("paint blue", (0.22, 0.17, 0.12), (0.46, 0.38, 0.29), wear=(0.12, 0.27, 0.36)),
        "terracotta": terracotta("terracotta"), "soil": soil("soil"), "cloth": cloth("cloth"),
        "wicker": wicker("wicker"), "wicker rim": bark("wicker rim"),
        "glaze": painted_ceramic("glaze", white, navy, (0.55, 0.28, 0.05), (9, 6)),
        "glaze lid": painted_ceramic("glaze lid", white, navy, (0.55, 0.28, 0.05), (8, 4)),
        "glaze small": painted_ceramic("glaze small", white, navy, (0.55, 0.28, 0.05), (9, 4)),
        "stoneware": painted_ceramic("stoneware", (0.42, 0.30, 0.19), (0.14, 0.07, 0.04), (0.62, 0.52, 0.36), (8, 6), 0.6),
        "blue": plain("blue", (0.05, 0.10, 0.30), roughness=0.35), "tea": plain("tea", (0.16, 0.05, 0.015)),
        "apple": fruit_skin("apple", (0.42, 0.03, 0.02), (0.55, 0.10, 0.04), (0.72, 0.45, 0.10), (0.75, 0.55, 0.3)),
        "orange": fruit_skin("orange", (0.70, 0.22, 0.02), (0.80, 0.30, 0.03), (0.86, 0.42, 0.06), (0.5, 0.13, 0.01), 0.5),
        "lemon": fruit_skin("lemon", (0.70, 0.48, 0.04), (0.80, 0.60, 0.06), (0.74, 0.66, 0.16), (0.5, 0.36, 0.05), 0.5),
        "pear": fruit_skin("pear", (0.40, 0.36, 0.08), (0.55, 0.48, 0.13), (0.52, 0.30, 0.10), (0.22, 0.14, 0.05), 0.55),
        "walnut": bark("walnut"), "bark": bark("bark"), "log end": log_end("log end"),
        "crust": crust("crust"), "crumb": plain("crumb", (0.74, 0.60, 0.40), 60.0, 0.5),
        "pages": pages("pages"), "gold": plain("gold", (0.72, 0.50, 0.16)), "cream": plain("cream", (0.80, 0.74, 0.60)),
        "cover green": book_cover("cover green", (0.06, 0.14, 0.08), (0.30, 0.30, 0.20)),
        "cover red": book_cover("cover red", (0.30, 0.04, 0.03), (0.45, 0.24, 0.16)),
        "cover blue": book_cover("cover blue", (0.05, 0.10, 0.20), (0.26, 0.30, 0.34)),
        "iron": plain("iron", (0.05, 0.045, 0.04), 40.0, 0.6), "enamel": plain("enamel", (0.04, 0.13, 0.20), 25.0, 0.5),
        "paper": plain("paper", (0.72, 0.64, 0.48), 30.0, 0.4), "stalk": plain("stalk", (0.10, 0.20, 0.05)),
        "eye": plain("eye", (0.75, 0.42, 0.03)), "eye brown": plain("eye brown", (0.08, 0.035, 0.015)),
        "leaf dark": foliage("leaf dark", (0.025, 0.07, 0.02), (0.12, 0.22, 0.05)),
        "leaf mid": foliage("leaf mid", (0.05, 0.13, 0.03), (0.20, 0.32, 0.07)),
        "leaf light": foliage("leaf light", (0.09, 0.20, 0.03), (0.30, 0.42, 0.09)),
        "leaf autumn": foliage("leaf autumn", (0.24, 0.10, 0.03), (0.62, 0.38, 0.09)),
        "petal white": foliage("petal white", (0.74, 0.72, 0.66), (0.82, 0.80, 0.76)),
        "petal yellow": foliage("petal yellow", (0.75, 0.42, 0.02), (0.82, 0.58, 0.05)),
        "petal red": foliage("petal red", (0.50, 0.03, 0.04), (0.72, 0.12, 0.12)),
    }


# ---------------------------------------------------------------- light, camera, render
def light_scene():
    """A hazy sun (soft-edged shadows) from the south-west and a clear sky, both fixed."""
    elevation, azimuth = math.radians(50), math.radians(232)
    d = Vector((math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)))
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle, sun.color = 3.6, math.radians(2.5), (1.0, 0.87, 0.70)
    link(bpy.data.objects.new("sun", sun)).rotation_euler = d.to_track_quat("Z", "Y").to_euler()
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type, sky.sun_disc = "NISHITA", False     # the lamp is the sun: much less noise
    sky.sun_elevation, sky.dust_density = elevation, 2.5
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs[0])
    tree.nodes["Background"].inputs[1].default_value = 0.26
    # The automatic map of a sky texture is 8192 wide: 4 s a view, and slow to sample from.
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 256


def camera_path(count):
    """Three turns round the table at three heights in rotation; (position, target) pairs.

    `count` must not be a multiple of three: then no two views share a bearing, and the
    bearings of all turns together are evenly spaced.  Height, distance and aim sway a
    little, as with somebody walking round with a camera.
    """
    poses = []
    for i in range(count):
        a = 2 * math.pi * 3 * i / count + 0.35
        level = (1.06, 1.36, 1.72)[i % 3]
        z = level + 0.06 * math.sin(5 * a)
        r = 1.58 + 0.24 * math.sin(2.3 * a + 1.0) - 0.25 * (level - 1.36)
        target = Vector((0.07 * math.sin(1.7 * a), 0.06 * math.cos(2.1 * a), 0.84 - 0.05 * (i % 3)))
        poses.append((Vector((r * math.cos(a), 0.97 * r * math.sin(a), z)), target))
    return poses


def setup_render(width, height, samples):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.use_persistent_data = True          # keep the BVH between views
    scene.view_settings.view_transform = "Filmic"
    scene.view_settings.look = "Medium High Contrast"
    scene.view_settings.exposure = 0.2
    c = scene.cycles
    c.device, c.samples, c.use_denoising = "CPU", samples, False
    c.use_adaptive_sampling = False                  # two rounds must weigh the same
    c.max_bounces, c.diffuse_bounces, c.glossy_bounces, c.transmission_bounces = 3, 2, 1, 1
    c.sample_clamp_indirect, c.blur_glossy = 2.0, 1.0
    c.caustics_reflective = c.caustics_refractive = False
    layer = bpy.context.view_layer                   # what develop.py's noise filter reads
    layer.use_pass_diffuse_direct = layer.use_pass_diffuse_indirect = True
    layer.use_pass_diffuse_color = layer.use_pass_normal = layer.use_pass_z = True
    camera = bpy.data.cameras.new("camera")
    camera.sensor_width, camera.lens = 36.0, 34.0    # 55.8 degrees across, as a 34 mm lens
    camera.clip_start = 0.02
    scene.camera = link(bpy.data.objects.new("camera", camera))
    return scene


def render_views(scene, out, count, only, round_):
    """One layered EXR per view.  Rounds differ in noise only; develop.py averages them."""
    image = scene.render.image_settings
    image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR_MULTILAYER", "16", "NONE"
    for i, (eye, target) in enumerate(camera_path(count)):
        if only and i not in only:
            continue
        scene.camera.location = eye
        scene.camera.rotation_euler = (target - eye).to_track_quat("-Z", "Y").to_euler()
        scene.cycles.seed = i + 1000 * round_            # noise must not repeat
        scene.render.filepath = os.path.join(out, f"view_{i:03d}.exr")
        start = time.time()
        bpy.ops.render.render(write_still=True)
        print(f"view {i}: {time.time() - start:.1f} s", flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", default="/tmp/scene/out")
    parser.add_argument("--views", type=int, default=40)
    parser.add_argument("--samples", type=int, default=8)
    parser.add_argument("--round", type=int, default=0, help="another round, other noise")
    parser.add_argument("--size", default="480x360")
    parser.add_argument("--only", default="", help="comma-separated view numbers")
    args = parser.parse_args(sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else [])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    width, height = map(int, args.size.split("x"))
    scene = setup_render(width, height, args.samples)
    m = make_materials()
    build_floor_and_walls(m)
    for part in (build_door, build_window, build_sign, build_logs, build_ivy, build_floor_items, build_still_life):
        part(m)
    light_scene()
    os.makedirs(args.out, exist_ok=True)
    only = {int(s) for s in args.only.split(",") if s}
    render_views(scene, args.out, args.views, only, args.round)


if __name__ == "__main__":
    main()
