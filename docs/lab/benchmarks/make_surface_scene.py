# SPDX-License-Identifier: Apache-2.0
"""Makes a scene whose surface is known, with Blender 3.4 (Debian 12).

    blender -b -noaudio -t 1 -P make_surface_scene.py -- statue|plaster|wires OUT [--size 512]
            [--views 64] [--samples 16] [--points 5000] [--seed 1]

writes OUT/images/*.png, a COLMAP model in OUT/sparse/0 with points and their tracks where the
pictures have texture, the surface OUT/truth.ply as far as two views see it, in triangles whose edges
are shorter than four pixels, OUT/truth_depth/*.png, depth along the viewing axis in units of 1e-4,
and OUT/truth_normals/*.png, in the axes of the world. `seed` moves the cameras. Rendered photos are kept, so that the same command goes on after an
interruption.

    statue   a head with a fine relief on a disc, all with texture
    plaster  the corner of a white room with vases, a car-paint ball, a mirror and one rug
    wires    a wheel of 36 spokes, a fence, a chair of tubes, a twig of thin leaves
"""

import argparse
import math
import os
import random
import struct
import sys
import zlib

import bpy
import numpy as np
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree

TURN = 2 * math.pi
DEPTH_UNIT = 1e-4
EDGE_PIXELS = 4.0   # the longest edge of the truth, at the distance of the cameras
NOISE_PIXELS = 0.3  # of the places of points in photos


def arguments():
    parser = argparse.ArgumentParser(prog="make_surface_scene.py")
    parser.add_argument("scene", choices=sorted(SCENES))
    parser.add_argument("out")
    parser.add_argument("--size", type=int, default=512, help="width and height of a photo")
    parser.add_argument("--views", type=int, default=64)
    parser.add_argument("--samples", type=int, default=16, help="of Cycles, a pixel")
    parser.add_argument("--points", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1:])


# --- Materials: lit by one sun without size, and by emission that depends on the normal. Nothing but
# the pixel's area is sampled, so that few samples give a picture without noise.

def material(first, second=None, kind=None, scale=4.0, specular=0.0, glow=1.0, **inputs):
    """`kind` of pattern between two colors: checker, voronoi or noise. Other inputs are those of the
    principled shader, as Roughness=0.2."""
    made = bpy.data.materials.new("material")
    made.use_nodes = True
    made.cycles.sample_as_light = False
    nodes, links = made.node_tree.nodes, made.node_tree.links
    surface = nodes["Principled BSDF"]
    for name, value in {"Specular": specular, "Roughness": 0.5, **inputs}.items():
        surface.inputs[name].default_value = value
    for name in ("Base Color", "Emission"):
        surface.inputs[name].default_value = (*first, 1)
        if kind:
            links.new(pattern(nodes, links, kind, first, second, scale), surface.inputs[name])
    links.new(ambient(nodes, links, glow), surface.inputs["Emission Strength"])
    return made


def pattern(nodes, links, kind, first, second, scale):
    texture = nodes.new({"checker": "ShaderNodeTexChecker", "noise": "ShaderNodeTexNoise",
                         "voronoi": "ShaderNodeTexVoronoi"}[kind])
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Object"], texture.inputs["Vector"])
    texture.inputs["Scale"].default_value = scale
    if kind == "checker":
        texture.inputs["Color1"].default_value = (*first, 1)
        texture.inputs["Color2"].default_value = (*second, 1)
        return texture.outputs["Color"]
    if kind == "noise":
        texture.inputs["Detail"].default_value = 6
    ramp = nodes.new("ShaderNodeValToRGB")
    for element, color, at in zip(ramp.color_ramp.elements, (first, second), (.3, .7)):
        element.color, element.position = (*color, 1), at
    links.new(texture.outputs["Distance" if kind == "voronoi" else "Fac"], ramp.inputs[0])
    return ramp.outputs[0]


def ambient(nodes, links, glow):
    """glow (0.4 + 0.13 z - 0.09 x) of the normal."""
    dot = nodes.new("ShaderNodeVectorMath")
    dot.operation = "DOT_PRODUCT"
    dot.inputs[1].default_value = (-.09 * glow, 0, .13 * glow)
    links.new(nodes.new("ShaderNodeNewGeometry").outputs["Normal"], dot.inputs[0])
    add = nodes.new("ShaderNodeMath")
    add.inputs[1].default_value = .4 * glow
    links.new(dot.outputs["Value"], add.inputs[0])
    return add.outputs[0]


# --- Objects

def add(primitive, look, is_smooth=True, **how):
    getattr(bpy.ops.mesh, f"primitive_{primitive}_add")(**how)
    return dress(bpy.context.object, look, is_smooth)


def dress(thing, look, is_smooth=True):
    thing.data.materials.append(look)
    for polygon in thing.data.polygons:
        polygon.use_smooth = is_smooth
    return thing


def solid(vertices, faces, look, is_smooth=True):
    mesh = bpy.data.meshes.new("mesh")
    mesh.from_pydata(vertices, [], faces)
    thing = bpy.data.objects.new("thing", mesh)
    bpy.context.scene.collection.objects.link(thing)
    return dress(thing, look, is_smooth)


def lathe(profile, look, place, steps=96):
    """Turns pairs (radius, height) about the z axis."""
    vertices = [(place[0] + r * math.cos(TURN * k / steps), place[1] + r * math.sin(TURN * k / steps),
                 place[2] + z) for r, z in profile for k in range(steps)]
    faces = [(i * steps + k, i * steps + (k + 1) % steps, (i + 1) * steps + (k + 1) % steps,
              (i + 1) * steps + k) for i in range(len(profile) - 1) for k in range(steps)]
    return solid(vertices, faces, look)


def vase(look, place, height, shape, wall=.03):
    """Open at its top, with a wall of this thickness."""
    outer = [(shape(t / 48), height * t / 48) for t in range(49)]
    inner = [(r - wall, max(z, wall)) for r, z in reversed(outer)]
    return lathe([(0, 0), *outer, *inner, (0, wall)], look, place)


def tube(a, b, radius, look, sides=16):
    a, b = Vector(a), Vector(b)
    made = add("cylinder", look, radius=radius, depth=(b - a).length, vertices=sides,
               location=(a + b) / 2, rotation=(b - a).to_track_quat("Z", "Y").to_euler())
    for polygon in made.data.polygons:
        polygon.use_smooth = len(polygon.vertices) == 4
    return made


def leaf(root, direction, length, look):
    """A sheet without thickness, bent along its length."""
    side = direction.cross(Vector((0, 0, 1))).normalized()
    vertices, faces = [], []
    for i in range(13):
        t = i / 12
        middle = root + length * (t * direction + Vector((0, 0, -.35 * t * t)))
        for k in range(5):
            across = (k / 2 - 1) * .28 * length * math.sin(math.pi * t) ** .8
            vertices.append(middle + across * side + Vector((0, 0, .25 * abs(across))))
    for i in range(12):
        faces += [(5 * i + k, 5 * i + k + 1, 5 * i + k + 6, 5 * i + k + 5) for k in range(4)]
    solid(vertices, faces, look)


def ground(look, radius):
    disc = add("cylinder", look, radius=radius, depth=.1, vertices=128, location=(0, 0, -.05))
    for polygon in disc.data.polygons:
        polygon.use_smooth = len(polygon.vertices) == 4


# --- Scenes. Each returns the point that cameras look at, their distance, the angles around and up
# that they cover, and the horizontal angle of view.

def statue():
    ground(material((.62, .55, .45), (.25, .2, .17), "checker", 5), 1.25)
    tube((0, 0, 0), (0, 0, .5), .3, material((.2, .35, .3), (.5, .6, .45), "voronoi", 7), 96)
    head = add("monkey", material((.75, .36, .18), (.35, .14, .08), "voronoi", 9), size=1.5,
               location=(0, 0, .95), rotation=(math.radians(-15), 0, 0))
    smooth = head.modifiers.new("smooth", "SUBSURF")
    smooth.levels = smooth.render_levels = 4
    relief = head.modifiers.new("relief", "DISPLACE")
    relief.texture = bpy.data.textures.new("noise", "CLOUDS")
    relief.texture.noise_scale, relief.strength = .08, .015
    return Vector((0, 0, .7)), 3.6, (0, TURN), (.05, 1.2), .69


def plaster():
    white = material((.62, .61, .59))
    for place, turn in (((2.5, 0, 2), (-math.pi / 2, 0, 0)), ((0, 2.5, 2), (0, math.pi / 2, 0)),
                        ((2.5, 2.5, 0), (0, 0, 0))):
        add("plane", white, size=6, location=place, rotation=turn)
    vase(material((.64, .62, .6)), (.7, .8, 0), .95,
         lambda t: .2 + .13 * math.sin(4.6 * t + .4) - .07 * t)
    vase(material((.55, .62, .66), specular=.5, Roughness=.15), (1.75, .55, 0), .6,
         lambda t: .12 + .2 * math.sin(math.pi * (.12 + .75 * t)))
    add("uv_sphere", material((.55, .03, .04), specular=.5, Roughness=.25, Metallic=.3,
                              Clearcoat=1.0, **{"Clearcoat Roughness": .02}),
        radius=.3, segments=96, ring_count=48, location=(1.3, 1.5, .32))
    tube((.55, 1.75, 0), (.55, 1.75, .8), .22,
         material((.92, .92, .92), glow=0, Metallic=1.0, Roughness=.02), 96)
    add("cube", material((.5, .1, .07), (.06, .09, .25), "checker", 6), is_smooth=False, size=1,
        location=(1.3, 1.2, .01), scale=(1.7, 1.3, .02))
    return Vector((1.0, 1.0, .45)), 3.4, (.2, TURN / 4 - .2), (.15, .85), .8


def wires():
    ground(material((.5, .45, .38), (.2, .25, .2), "noise", 6), 1.35)
    metal = material((.7, .72, .75), (.4, .42, .5), "noise", 20)
    rubber = material((.12, .12, .13), (.3, .28, .26), "noise", 30)
    hub, radius = Vector((-.35, .1, .68)), .62
    add("torus", rubber, major_radius=radius + .02, minor_radius=.035, major_segments=160,
        minor_segments=16, location=hub, rotation=(math.pi / 2, 0, 0))
    tube(hub - Vector((0, .09, 0)), hub + Vector((0, .09, 0)), .045, metal, 32)
    for k in range(36):
        angle = TURN * k / 36
        rim = hub + radius * Vector((math.cos(angle), 0, math.sin(angle)))
        turned = angle + (.5 if k % 4 < 2 else -.5)
        at_hub = .04 * Vector((math.cos(turned), 0, math.sin(turned)))
        tube(hub + at_hub + Vector((0, .07 if k % 2 else -.07, 0)), rim, .0042, metal, 8)
    wood = material((.5, .3, .14), (.75, .5, .28), "noise", 9)
    for k in range(9):
        x = -.95 + .24 * k
        tube((x, .75, 0), (x, .75, .75), .012, wood, 12)
    for z in (.1, .25, .4, .55, .7):
        tube((-1, .75, z), (1, .75, z), .009, wood, 12)
    paint = material((.75, .55, .1), (.6, .2, .1), "voronoi", 12)
    seat = [Vector((.4 + .45 * x, -.5 + .45 * y, .42)) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    for k, corner in enumerate(seat):
        top = .95 if k > 1 else .42
        tube((corner.x, corner.y, 0), (corner.x, corner.y, top), .018, paint)
        tube(corner, seat[(k + 1) % 4], .018, paint)
    for z in (.6, .77, .94):
        tube((seat[2].x, seat[2].y, z), (seat[3].x, seat[3].y, z), .014, paint)
    for k in range(1, 6):
        tube(seat[0].lerp(seat[1], k / 6), seat[3].lerp(seat[2], k / 6), .01, paint)
    green = material((.12, .4, .1), (.5, .6, .2), "noise", 14)
    tube((-.3, -.75, 0), (-.3, -.75, .8), .012, wood, 12)
    for k in range(14):
        angle = 2.4 * k
        leaf(Vector((-.3, -.75, .15 + .048 * k)),
             Vector((math.cos(angle), math.sin(angle), .55)).normalized(), .3, green)
    return Vector((0, 0, .42)), 3.6, (0, TURN), (.08, 1.0), .69


SCENES = {"statue": statue, "plaster": plaster, "wires": wires}


# --- Cameras

def camera_poses(count, view, seed):
    """Even over the angles; every eighth is as even. Blender's axes: looking along -z, y up."""
    target, distance, around, up, _ = view
    draw, poses = random.Random(seed), []
    for i in range(count):
        a = around[0] + (around[1] - around[0]) * ((i * 0.6180339887) % 1)
        sines = [math.sin(angle) for angle in up]
        height = sines[0] + (sines[1] - sines[0]) * ((i * 0.7548776662 + draw.uniform(0, .1)) % 1)
        a, flat = a + draw.uniform(-.06, .06), math.sqrt(1 - height * height)
        place = target + distance * draw.uniform(.92, 1.08) * Vector(
            (math.cos(a) * flat, math.sin(a) * flat, height))
        aim = target + Vector([draw.uniform(-.05, .05) for _ in range(3)])
        pose = (aim - place).to_track_quat("-Z", "Y").to_matrix().to_4x4()
        pose.translation = place
        poses.append(pose)
    return poses


def cam_from_world(pose):
    return Matrix.Diagonal((1, -1, -1, 1)) @ pose.inverted()


# --- Rendering

def set_up(options):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("black")
    scene.world.color = (0, 0, 0)
    render, cycles = scene.render, None
    render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling = "CPU", options.samples, False
    cycles.max_bounces = cycles.glossy_bounces = 2 if options.scene == "plaster" else 0
    cycles.diffuse_bounces = 0
    cycles.use_denoising = False
    render.resolution_x = render.resolution_y = options.size
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    render.use_persistent_data, render.use_file_extension = True, False
    render.dither_intensity = 0
    scene.view_settings.view_transform = "Standard"
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = 1.8, 0
    holder = bpy.data.objects.new("sun", sun)
    holder.rotation_euler = (-Vector((2.2, 1.4, 3.6))).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(holder)
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    return scene


def render_photos(scene, options, poses, names):
    for i, (pose, name) in enumerate(zip(poses, names)):
        path = f"{options.out}/images/{name}"
        if os.path.exists(path):
            continue
        scene.camera.matrix_world = pose
        scene.cycles.seed = i
        scene.render.filepath = path + ".part"
        bpy.ops.render.render(write_still=True)
        os.rename(path + ".part", path)


def pixels_of(path):
    """(H, W, 3), from 0 to 1, in sRGB as the file has them."""
    image = bpy.data.images.load(os.path.abspath(path))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    pixels = np.array(image.pixels[:], np.float32).reshape(height, width, 4)[::-1, :, :3]
    bpy.data.images.remove(image)
    return pixels


# --- The surface

def triangles_of_scene():
    """(F, 3, 3) in world axes, as rendered."""
    parts, depsgraph = [], bpy.context.evaluated_depsgraph_get()
    for thing in bpy.context.scene.objects:
        if thing.type != "MESH":
            continue
        evaluated = thing.evaluated_get(depsgraph)
        mesh = evaluated.to_mesh()
        mesh.calc_loop_triangles()
        vertices = np.array([evaluated.matrix_world @ v.co for v in mesh.vertices])
        parts.append(vertices[[t.vertices[:] for t in mesh.loop_triangles]])
        evaluated.to_mesh_clear()
    return np.concatenate(parts)


def with_short_edges(triangles, longest):
    """Halves triangles at their longest edge, until none is longer."""
    done = []
    while len(triangles):
        lengths = np.linalg.norm(triangles - np.roll(triangles, -1, 1), axis=2)
        edge = lengths.argmax(1)
        is_short = lengths.max(1) <= longest
        done.append(triangles[is_short])
        triangles, edge = triangles[~is_short], edge[~is_short]
        rows = np.arange(len(triangles))
        a, b, c = (triangles[rows, (edge + k) % 3] for k in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
    return np.concatenate(done)


def surface_of(tree, pose, size, focal):
    """Through the centers of pixels: depth along the viewing axis, (H, W), and normals towards the
    camera, (H, W, 3); 0 where nothing is."""
    axes, place = pose.to_3x3(), pose.translation
    depth, normals = np.zeros((size, size), np.float32), np.zeros((size, size, 3), np.float32)
    for y in range(size):
        for x in range(size):
            ray = axes @ Vector(((x + .5 - size / 2) / focal, (size / 2 - y - .5) / focal, -1))
            _, normal, _, hit = tree.ray_cast(place, ray)
            if hit is not None:
                depth[y, x] = hit / ray.length
                normals[y, x] = -normal if normal.dot(ray) > 0 else normal
    return depth, normals


class Views:
    """Known cameras with their depth."""

    def __init__(self, poses, depths, focal):
        self.poses = [np.array(cam_from_world(pose)) for pose in poses]
        self.depths, self.focal = depths, focal

    def project(self, k, points):
        """Places in pixels, depths, and whether the photo shows the points."""
        size = self.depths[k].shape[0]
        c = points @ self.poses[k][:3, :3].T + self.poses[k][:3, 3]
        z = np.maximum(c[:, 2], 1e-6)
        at = self.focal * c[:, :2] / z[:, None] + size / 2
        inside = (c[:, 2] > 0) & (at > 1).all(1) & (at < size - 1).all(1)
        x, y = (np.clip(at[:, i].astype(int), 1, size - 2) for i in (0, 1))
        gaps = [np.abs(self.depths[k][y + dy, x + dx] - z) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
        return at, z, inside & (np.min(gaps, 0) < 2 * z / self.focal)

    def seen(self, points):
        """By how many views."""
        return sum(self.project(k, points)[2].astype(int) for k in range(len(self.poses)))


# --- Files

def write_numbers(path, values):
    """A PNG of 16 bits, (H, W) or (H, W, 3)."""
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))
    height, width = values.shape[:2]
    kind = 2 if values.ndim == 3 else 0
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in values)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" +
                   chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(rows, 6)) + chunk(b"IEND", b""))


def write_surface(path, triangles):
    vertices, corners = np.unique(triangles.reshape(-1, 3).astype("<f4"), axis=0,
                                  return_inverse=True)
    faces = np.zeros(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, corners.reshape(-1, 3)
    with open(path, "wb") as file:
        file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
                   "property float x\nproperty float y\nproperty float z\n"
                   f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
                   "end_header\n".encode())
        file.write(vertices.tobytes() + faces.tobytes())


def sparse_points(views, photos, names, count, draw):
    """Points at pixels with texture, with errors of half a pixel, and the photos that show them."""
    size, points, colors = photos[0].shape[0], [], []
    while len(points) < count:
        k = draw.integers(len(names))
        y, x = draw.integers(2, size - 2, 2)
        z, here = views.depths[k][y, x], photos[k][y, x]
        change = sum(np.abs(photos[k][y + dy, x + dx] - here).sum() for dy, dx in ((0, 2), (2, 0)))
        if z == 0 or change < .12:
            continue
        c = np.array([(x + .5 - size / 2) / views.focal, (y + .5 - size / 2) / views.focal, 1]) * z
        point = views.poses[k][:3, :3].T @ (c - views.poses[k][:3, 3])
        points.append(point + draw.normal(0, .5 * z / views.focal, 3))
        colors.append(np.round(255 * here).astype(int))
    return np.array(points), colors


def write_model(folder, options, views, photos, names):
    os.makedirs(folder, exist_ok=True)
    half, focal, draw = options.size / 2, views.focal, np.random.default_rng(options.seed)
    points, colors = sparse_points(views, photos, names, options.points, draw)
    with open(f"{folder}/cameras.txt", "w") as file:
        file.write(f"1 PINHOLE {options.size} {options.size} {focal:.9f} {focal:.9f} {half} {half}\n")
    tracks = [[] for _ in points]
    with open(f"{folder}/images.txt", "w") as file:
        for k, name in enumerate(names):
            pose = Matrix(views.poses[k].tolist())
            numbers = [*pose.to_quaternion(), *pose.translation]
            file.write(f"{k + 1} {' '.join(f'{x:.9f}' for x in numbers)} 1 {name}\n")
            at, _, is_seen = views.project(k, points)
            places = []
            for i in np.flatnonzero(is_seen):
                tracks[i].append(f"{k + 1} {len(places)}")
                u, v = at[i] + draw.normal(0, NOISE_PIXELS, 2)
                places.append(f"{u:.3f} {v:.3f} {i + 1}")
            file.write(" ".join(places) + "\n")
    with open(f"{folder}/points3D.txt", "w") as file:
        for i, (p, color) in enumerate(zip(points, colors)):
            file.write(f"{i + 1} {p[0]:.6f} {p[1]:.6f} {p[2]:.6f} {color[0]} {color[1]} {color[2]} "
                       f"{NOISE_PIXELS} {' '.join(tracks[i])}\n")


def main():
    options = arguments()
    scene = set_up(options)
    view = SCENES[options.scene]()
    scene.camera.data.sensor_width, scene.camera.data.angle_x = 32, view[4]
    focal = options.size / 2 / math.tan(view[4] / 2)
    names = [f"{k:03d}.png" for k in range(options.views)]
    poses = camera_poses(options.views, view, options.seed)
    triangles = triangles_of_scene()
    tree = BVHTree.FromPolygons(triangles.reshape(-1, 3).tolist(),
                                np.arange(3 * len(triangles)).reshape(-1, 3).tolist())
    render_photos(scene, options, poses, names)
    surfaces = [surface_of(tree, pose, options.size, focal) for pose in poses]
    views = Views(poses, [depth for depth, _ in surfaces], focal)
    for kind in ("truth_depth", "truth_normals"):
        os.makedirs(f"{options.out}/{kind}", exist_ok=True)
    for name, (depth, normals) in zip(names, surfaces):
        write_numbers(f"{options.out}/truth_depth/{name}", np.round(depth / DEPTH_UNIT))
        write_numbers(f"{options.out}/truth_normals/{name}",
                      np.round(65535 * (.5 + .5 * normals)) * (depth > 0)[..., None])
    photos = [pixels_of(f"{options.out}/images/{name}") for name in names]
    write_model(f"{options.out}/sparse/0", options, views, photos, names)
    triangles = with_short_edges(triangles, EDGE_PIXELS * view[1] / focal)
    is_seen = (views.seen(triangles.reshape(-1, 3)) >= 2).reshape(-1, 3).any(1)
    write_surface(f"{options.out}/truth.ply", triangles[is_seen])
    print(f"{options.out}: {is_seen.sum()} of {len(triangles)} triangles are seen")


main()
