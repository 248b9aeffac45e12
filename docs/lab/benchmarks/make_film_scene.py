"""Makes a scene that cameras film while they stand still, as in the Neural 3D Video data set.

    blender -b -noaudio -P make_film_scene.py -- OUT [--cameras 12] [--frames 60] [--size 400]
            [--samples 10]

writes OUT/images/cam00.mp4 ... cam11.mp4 (H.264; one a camera) and a COLMAP model of one image a
camera, OUT/sparse/0, with points on the surfaces of the first moment. The content is that of
suzanne_dynamic: a head that twists and nods, bouncing balls, a flag, an arm of two links, all over
black. Needs Blender 3.4 (Debian 12) and ffmpeg. A frame takes half a second on two cores; rendered
frames stay in OUT/rendered, and the same command goes on after an interruption.
"""

import argparse
import math
import os
import random
import shutil
import subprocess
import sys

import bpy
from mathutils import Matrix, Vector

TURN = 2 * math.pi
DISTANCE, TARGET = 4.6, Vector((0, 0, 0.55))
FIELD_OF_VIEW = 0.6911112070083618  # radians, horizontal: that of the synthetic NeRF scenes
POINTS = 6000
FRAMES_PER_SECOND = 30


def arguments():
    parser = argparse.ArgumentParser(prog="make_film_scene.py")
    parser.add_argument("out")
    parser.add_argument("--cameras", type=int, default=12)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--size", type=int, default=400, help="width and height, even")
    parser.add_argument("--samples", type=int, default=10, help="of Cycles, a pixel")
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1:])


# --- Materials: a color or a pattern, lit by one sun and by emission that depends on the normal.
# Nothing but the pixel's area is sampled, so that few samples give a picture without noise.

def pattern(nodes, links, kind, first, second, scale):
    """The output of a node that mixes two colors."""
    coordinates = nodes.new("ShaderNodeTexCoord").outputs["Generated"]
    if kind == "checker":
        texture = nodes.new("ShaderNodeTexChecker")
        texture.inputs["Color1"].default_value = (*first, 1)
        texture.inputs["Color2"].default_value = (*second, 1)
        texture.inputs["Scale"].default_value = scale
        links.new(coordinates, texture.inputs["Vector"])
        return texture.outputs["Color"]
    texture = nodes.new({"stripe": "ShaderNodeTexWave", "voronoi": "ShaderNodeTexVoronoi",
                         "noise": "ShaderNodeTexNoise"}[kind])
    texture.inputs["Scale"].default_value = scale
    links.new(coordinates, texture.inputs["Vector"])
    ramp = nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color = (*first, 1)
    ramp.color_ramp.elements[1].color = (*second, 1)
    if kind == "stripe":
        texture.bands_direction = "X"
        ramp.color_ramp.interpolation = "CONSTANT"
        ramp.color_ramp.elements[1].position = 0.5
    else:
        ramp.color_ramp.elements[0].position = 0.3
        ramp.color_ramp.elements[1].position = 0.7
    links.new(texture.outputs["Fac" if kind != "voronoi" else "Distance"], ramp.inputs[0])
    return ramp.outputs[0]


def ambient_strength(nodes, links):
    """0.4 + 0.13 z - 0.09 x of the normal."""
    normal = nodes.new("ShaderNodeNewGeometry").outputs["Normal"]
    parts = nodes.new("ShaderNodeSeparateXYZ")
    links.new(normal, parts.inputs[0])
    sum_so_far = None
    for axis, factor in (("Z", 0.13), ("X", -0.09)):
        add = nodes.new("ShaderNodeMath")
        add.operation = "MULTIPLY_ADD"
        add.inputs[1].default_value = factor
        add.inputs[2].default_value = 0.4
        links.new(parts.outputs[axis], add.inputs[0])
        if sum_so_far:
            links.new(sum_so_far, add.inputs[2])
        sum_so_far = add.outputs[0]
    return sum_so_far


def material(first, second=None, kind=None, scale=4.0, roughness=0.55, specular=0.0):
    made = bpy.data.materials.new("material")
    made.use_nodes = True
    made.diffuse_color = (*first, 1)  # read for the points of the model
    made.cycles.sample_as_light = False
    nodes, links = made.node_tree.nodes, made.node_tree.links
    surface = nodes["Principled BSDF"]
    surface.inputs["Roughness"].default_value = roughness
    surface.inputs["Specular"].default_value = specular
    for name in ("Base Color", "Emission"):
        surface.inputs[name].default_value = (*first, 1)
    if kind:
        color = pattern(nodes, links, kind, first, second, scale)
        links.new(color, surface.inputs["Base Color"])
        links.new(color, surface.inputs["Emission"])
    links.new(ambient_strength(nodes, links), surface.inputs["Emission Strength"])
    return made


# --- Objects

def add(primitive, look, is_smooth=True, **how):
    getattr(bpy.ops.mesh, f"primitive_{primitive}_add")(**how)
    made = bpy.context.object
    made.data.materials.append(look)
    for polygon in made.data.polygons:
        polygon.use_smooth = is_smooth
    return made


def add_link(look, length, radius):
    """A cylinder that begins at its origin and points up."""
    link = add("cylinder", look, depth=length, radius=radius, vertices=40)
    for vertex in link.data.vertices:
        vertex.co.z += length / 2
    return link


def put_on(child, parent, height):
    child.parent = parent
    child.location = (0, 0, height)


class Moving:
    """The objects, and where they are at a time from 0 to 1."""

    def __init__(self):
        base = add("cylinder", material((.50, .38, .27), (.33, .22, .15), "checker", 7),
                   radius=1.35, depth=.12, vertices=96, location=(0, 0, -.06))
        for polygon in base.data.polygons:
            polygon.use_smooth = len(polygon.vertices) == 4
        add("torus", material((.85, .65, .15), roughness=.3, specular=.5), major_radius=1.35,
            minor_radius=.05, major_segments=96, minor_segments=16)
        add("cylinder", material((.16, .30, .24)), radius=.16, depth=.5, location=(0, 0, .2),
            vertices=48)
        self.head = add("monkey", material((.70, .28, .12), (.30, .10, .05), "noise", 3.5),
                        size=.95)
        smooth = self.head.modifiers.new("smooth", "SUBSURF")
        smooth.levels = smooth.render_levels = 2
        self.twist = self.head.modifiers.new("twist", "SIMPLE_DEFORM")
        self.twist.deform_method, self.twist.deform_axis = "TWIST", "Z"
        self.balls = [
            add("uv_sphere", look, radius=.2, segments=48, ring_count=24) for look in (
                material((.85, .10, .10), (.95, .90, .80), "stripe", 1.2, .3, .5),
                material((.10, .25, .80), (.85, .85, .20), "checker", 4, .3, .5),
                material((.10, .55, .25), (.75, .95, .60), "voronoi", 4, .3, .5))]
        add("cylinder", material((.35, .35, .38), roughness=.3, specular=.6), radius=.03,
            depth=1.7, location=(-.95, .55, .85), vertices=24)
        self.flag = add("grid", material((.92, .92, .90), (.75, .08, .12), "stripe", 1.6, .8),
                        x_subdivisions=48, y_subdivisions=24, size=1)
        self.flag_at_rest = [vertex.co.copy() for vertex in self.flag.data.vertices]
        metal = material((.15, .45, .75), (.05, .15, .35), "checker", 6)
        self.lower, self.upper = add_link(metal, .55, .09), add_link(metal, .5, .07)
        self.lower.location = (.85, .55, 0)
        joint = add("uv_sphere", material((.95, .55, .10)), radius=.12, segments=32, ring_count=16)
        self.hand = add("cube", material((.90, .30, .60), (.30, .05, .25), "checker", 3),
                        is_smooth=False, size=.2)
        put_on(joint, self.lower, .55)
        put_on(self.upper, self.lower, .55)
        put_on(self.hand, self.upper, .55)

    def move_to(self, t):
        self.twist.angle = math.radians(55) * math.sin(TURN * t)
        self.head.rotation_euler = (math.radians(-12) + .25 * math.sin(2 * TURN * t), 0,
                                    math.radians(35) * math.sin(TURN * t + .8))
        self.head.location = (0, 0, .80 + .07 * math.sin(2 * TURN * t))
        for i, ball in enumerate(self.balls):
            height = abs(math.sin(math.pi * (2 * t + i / 3)))
            angle = TURN * i / 3 + 1.1 + .9 * math.sin(TURN * t + i)
            flat = 1 - .35 * max(0, 1 - height / .18)  # on the ground
            ball.location = (.98 * math.cos(angle), .98 * math.sin(angle), .2 * flat + .75 * height)
            ball.scale = (1 / math.sqrt(flat), 1 / math.sqrt(flat), flat)
            ball.rotation_euler = (0, 0, 1.5 * math.sin(TURN * t + 2 * i))
        for vertex, rest in zip(self.flag.data.vertices, self.flag_at_rest):
            u = rest.x + .5
            vertex.co = (.85 * u, .14 * u * math.sin(TURN * (1.25 * u - 2 * t)),
                         .5 * rest.y + .03 * u * math.sin(TURN * (u + t)) - .05 * u * u)
        self.flag.data.update()
        self.flag.location = (-.95, .55, 1.42)
        self.flag.rotation_euler = (0, 0, math.radians(-35) + .3 * math.sin(TURN * t))
        self.lower.rotation_euler = (.45 * math.sin(TURN * t), .35 * math.cos(TURN * t),
                                     TURN * t / 2)
        self.upper.rotation_euler = (.9 + .6 * math.sin(TURN * t + 1), 0, 0)
        self.hand.rotation_euler = (0, 0, TURN * t)
        bpy.context.view_layer.update()


# --- Cameras

def camera_poses(cameras):
    """Around the scene, at three heights. Blender's axes: x right, y up, looking along -z."""
    poses = []
    for i in range(cameras):
        around, up = TURN * i / cameras, (0.25, 0.6, 0.95)[i % 3]
        place = TARGET + DISTANCE * Vector((math.cos(around) * math.cos(up),
                                            math.sin(around) * math.cos(up), math.sin(up)))
        pose = (TARGET - place).to_track_quat("-Z", "Y").to_matrix().to_4x4()
        pose.translation = place
        poses.append(pose)
    return poses


# --- Files

def set_up(options):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("black")
    scene.world.color = (0, 0, 0)
    render, cycles = scene.render, None
    render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling = "CPU", options.samples, False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = 0
    cycles.use_denoising = False
    render.resolution_x = render.resolution_y = options.size
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    render.use_persistent_data = True
    render.dither_intensity = 0
    scene.view_settings.view_transform = "Standard"
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = 2.6, 0
    holder = bpy.data.objects.new("sun", sun)
    holder.rotation_euler = (-Vector((2.2, -2.0, 3.6))).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(holder)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.sensor_width, camera.data.angle_x = 32, FIELD_OF_VIEW
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def surface_points(count):
    """Points with colors, equally dense on all surfaces."""
    triangles, areas = [], []
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for thing in bpy.context.scene.objects:
        if thing.type != "MESH":
            continue
        color = thing.data.materials[0].diffuse_color
        evaluated = thing.evaluated_get(depsgraph)
        mesh = evaluated.to_mesh()
        mesh.calc_loop_triangles()
        for triangle in mesh.loop_triangles:
            corners = [evaluated.matrix_world @ mesh.vertices[i].co for i in triangle.vertices]
            triangles.append((corners, color))
            areas.append((corners[1] - corners[0]).cross(corners[2] - corners[0]).length)
        evaluated.to_mesh_clear()
    dice = random.Random(1)
    for (a, b, c), color in dice.choices(triangles, areas, k=count):
        u, v = dice.random(), dice.random()
        if u + v > 1:
            u, v = 1 - u, 1 - v
        yield a + u * (b - a) + v * (c - a), [round(255 * x ** (1 / 2.2)) for x in color[:3]]


def write_model(folder, options, poses):
    os.makedirs(folder, exist_ok=True)
    focal = options.size / 2 / math.tan(FIELD_OF_VIEW / 2)
    with open(f"{folder}/cameras.txt", "w") as file:
        file.write(f"1 PINHOLE {options.size} {options.size} {focal:.9f} {focal:.9f} "
                   f"{options.size / 2} {options.size / 2}\n")
    with open(f"{folder}/images.txt", "w") as file:
        for i, pose in enumerate(poses):
            cam_from_world = Matrix.Diagonal((1, -1, -1, 1)) @ pose.inverted()
            numbers = [*cam_from_world.to_quaternion(), *cam_from_world.translation]
            text = " ".join(f"{x:.9f}" for x in numbers)
            file.write(f"{i + 1} {text} 1 cam{i:02d}.png\n\n")
    with open(f"{folder}/points3D.txt", "w") as file:
        for i, (place, color) in enumerate(surface_points(POINTS)):
            file.write(f"{i + 1} {place.x:.5f} {place.y:.5f} {place.z:.5f} "
                       f"{color[0]} {color[1]} {color[2]} 0\n")


def main():
    options = arguments()
    if not shutil.which("ffmpeg"):
        sys.exit("make_film_scene.py needs the program ffmpeg: apt install ffmpeg")
    scene = set_up(options)
    moving, poses = Moving(), camera_poses(options.cameras)
    moving.move_to(0)
    write_model(f"{options.out}/sparse/0", options, poses)
    for frame in range(options.frames):
        moving.move_to(frame / (options.frames - 1))
        for i, pose in enumerate(poses):
            path = f"{options.out}/rendered/cam{i:02d}/{frame:04d}.png"
            if os.path.exists(path):
                continue
            scene.camera.matrix_world = pose
            scene.cycles.seed = frame * options.cameras + i
            scene.render.filepath = path + ".part"
            scene.render.use_file_extension = False
            bpy.ops.render.render(write_still=True)
            os.rename(path + ".part", path)
    os.makedirs(f"{options.out}/images", exist_ok=True)
    for i in range(options.cameras):
        subprocess.run(["ffmpeg", "-v", "error", "-y", "-framerate", str(FRAMES_PER_SECOND), "-i",
                        f"{options.out}/rendered/cam{i:02d}/%04d.png", "-c:v", "libx264", "-crf",
                        "12", "-preset", "slow", "-pix_fmt", "yuv420p",
                        f"{options.out}/images/cam{i:02d}.mp4"], check=True)


main()
