"""Pictures of a GLB by Blender, from the cameras of OUT/ours/ORBIT/transforms.json.

    blender --background --factory-startup --python blender_render.py -- MESH.glb OUT ORBIT...
"""

import json
import math
import os
import sys

import bpy
import numpy
from mathutils import Matrix, Vector

mesh_file, out, *orbits = sys.argv[sys.argv.index("--") + 1 :]

# Debian's Blender 3.4 has an importer that numpy 1.24 took a name from.
if "bool" not in vars(numpy):
    numpy.bool = bool

# glTF's +y is up; Blender's importer turns it to +z.
TO_BLENDER = Matrix.Rotation(math.pi / 2, 4, "X")

# Narrower than Blender lets pixels be: its samples lie in their middles.
PIXEL_FILTER = 0.01


def empty_scene():
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    # Nothing is lit: one sample is exact.
    scene.cycles.samples = 1
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type = "GAUSSIAN"
    scene.cycles.filter_width = PIXEL_FILTER
    scene.render.film_transparent = True
    scene.render.dither_intensity = 0.0
    scene.render.resolution_percentage = 100
    scene.render.use_persistent_data = True
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.image_settings.color_depth = "8"
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    scene.view_settings.exposure = 0.0
    scene.view_settings.gamma = 1.0
    return scene


def corners_of(things):
    low, high = Vector([math.inf] * 3), Vector([-math.inf] * 3)
    for thing in things:
        for vertex in thing.data.vertices:
            place = thing.matrix_world @ vertex.co
            low = Vector(map(min, low, place))
            high = Vector(map(max, high, place))
    return low, high


def is_unlit(material):
    kinds = {node.type for node in material.node_tree.nodes}
    return "EMISSION" in kinds and "BSDF_PRINCIPLED" not in kinds


def described(things, low, high):
    materials = [slot.material for thing in things for slot in thing.material_slots]
    images = {node.image for m in materials for node in m.node_tree.nodes if node.type == "TEX_IMAGE"}
    names = {
        "nodes": [thing.name for thing in things],
        "meshes": [thing.data.name for thing in things],
        "materials": [material.name for material in materials],
        "images": [image.name for image in images],
    }
    return {
        "version": bpy.app.version_string,
        "names": names,
        "vertices": sum(len(thing.data.vertices) for thing in things),
        "triangles": sum(len(thing.data.polygons) for thing in things),
        "unlit": all(map(is_unlit, materials)),
        "scale_length": bpy.context.scene.unit_settings.scale_length,
        "low": list(low),
        "high": list(high),
    }


def place(camera, frame, low, high):
    """Puts the camera where a frame of transforms.json is: y up, a view along -z, as Blender has cameras."""
    data, width, height = camera.data, frame["w"], frame["h"]
    camera.matrix_world = TO_BLENDER @ Matrix(frame["transform_matrix"])
    data.sensor_fit = "HORIZONTAL"
    data.lens = data.sensor_width * frame["fl_x"] / width
    data.shift_x = 0.5 - frame["cx"] / width
    data.shift_y = (frame["cy"] - 0.5 * height) / width
    distance = (camera.matrix_world.translation - 0.5 * (low + high)).length
    data.clip_start, data.clip_end = 0.01 * distance, 100.0 * distance


def main():
    scene = empty_scene()
    bpy.ops.import_scene.gltf(filepath=os.path.abspath(mesh_file))
    things = [thing for thing in scene.objects if thing.type == "MESH"]
    low, high = corners_of(things)
    os.makedirs(os.path.join(out, "blender"), exist_ok=True)
    with open(os.path.join(out, "blender", "scene.json"), "w") as file:
        json.dump(described(things, low, high), file, indent=2)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    for orbit in orbits:
        with open(os.path.join(out, "ours", orbit, "transforms.json")) as file:
            frames = json.load(file)["frames"]
        for frame in frames:
            place(camera, frame, low, high)
            scene.render.resolution_x, scene.render.resolution_y = frame["w"], frame["h"]
            scene.render.filepath = os.path.join(out, "blender", orbit, frame["file_path"])
            bpy.ops.render.render(write_still=True)


main()
