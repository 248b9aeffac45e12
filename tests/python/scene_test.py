# SPDX-License-Identifier: Apache-2.0
"""gemsplat.Scene and gemsplat.Camera."""

import gc
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import gemsplat
from support import COURTYARD, SMALL, SOURCE, TestCase, camera


class Scenes(TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scene = gemsplat.Scene.load(COURTYARD, **SMALL)

    def test_views_are_split_and_sorted(self):
        names = [view.name for view in self.scene.train_views + self.scene.test_views]
        held_out = [view.name for view in self.scene.test_views]
        self.assertEqual(held_out, sorted(names)[::8])
        self.assertEqual([view.name for view in self.scene.train_views], sorted(set(names) - set(held_out)))
        self.assertEqual(gemsplat.Scene.load(COURTYARD, resolution=8).test_views, [])

    def test_panoramas_of_make_room_are_two_views_of_the_room(self):
        sys.path.insert(0, str(SOURCE / "scripts"))
        self.addCleanup(sys.path.remove, str(SOURCE / "scripts"))
        import make_room
        with tempfile.TemporaryDirectory() as folder:
            make_room.write_scene(Path(folder), make_room.Panorama(64), 2, 0)
            back, front = gemsplat.Scene.load(folder, resolution=1).train_views[:2]
        self.assertEqual((back.name, front.name, front.camera.lens), ("000.back.png", "000.front.png", "fisheye"))
        middle, side = front.camera.width // 2, front.camera.fx
        for view in (back, front):  # ahead, and to the right
            for x, ray in ((middle, [0, 0, 1]), (int(view.camera.cx + side), [np.sin(1), 0, np.cos(1)])):
                ray = ray @ view.camera.cam_from_world[:3, :3]
                _, color = make_room.cast(view.camera.position, ray[None])
                self.assertLess(np.abs(view.photo[middle, x] / 255.0 - color[0]).max(), 0.25)  # checkers are coarse here

    def test_photos_are_arrays_of_the_cameras_size(self):
        view = self.scene.train_views[0]
        self.assertEqual(view.photo.shape, (45, 60, 3))
        self.assertEqual(view.photo.dtype, np.uint8)
        self.assertEqual((view.camera.width, view.camera.height), (60, 45))
        self.assertGreater(view.photo.std(), 10)
        self.assertIsNone(view.mask)
        self.assertEqual(view.exposure, (1.0, 1.0, 1.0))
        with self.assertRaises(ValueError):
            view.photo[0, 0, 0] = 1

    def test_arrays_keep_their_scene(self):
        scene = gemsplat.Scene.load(COURTYARD, **SMALL)
        photo, points = scene.train_views[0].photo, scene.points
        first, sum_of_photo = points[0].copy(), int(photo.sum())
        del scene
        gc.collect()
        np.testing.assert_array_equal(points[0], first)
        self.assertEqual(int(photo.sum()), sum_of_photo)

    def test_points_have_positions_and_colors(self):
        self.assertEqual(self.scene.points.shape[1], 3)
        self.assertEqual(self.scene.points.shape, self.scene.point_colors.shape)
        self.assertGreater(len(self.scene.points), 100)
        self.assertGreater(self.scene.point_colors.std(), 10)
        self.assertGreater(self.scene.extent, 0)

    def test_a_scene_of_arrays_is_what_was_given(self):
        views = [(view.camera, view.photo) for view in self.scene.train_views]
        scene = gemsplat.Scene(views[::-1], points=self.scene.points, point_colors=self.scene.point_colors)
        self.assertEqual([view.name for view in scene.train_views], [view.name for view in self.scene.train_views])
        np.testing.assert_array_equal(scene.train_views[2].photo, self.scene.train_views[2].photo)
        np.testing.assert_array_equal(scene.points, self.scene.points)
        np.testing.assert_array_equal(scene.point_colors, self.scene.point_colors)
        self.assertEqual(scene.extent, self.scene.extent)

    def test_what_is_no_scene_is_refused(self):
        with self.assertRaisesRegex(gemsplat.Error, "nowhere"):
            gemsplat.Scene.load(self.folder / "nowhere")
        self.assert_refused("no setting dataset.resolutio.*did you mean dataset.resolution", gemsplat.Scene.load,
                            COURTYARD, resolutio=8)
        self.assert_refused("dataset.resolution", gemsplat.Scene.load, COURTYARD, resolution=3)
        photo = np.zeros((48, 64, 3))
        self.assert_refused("a photo must hold uint8", gemsplat.Scene, [(camera(), photo)])
        self.assert_refused(r"a photo must have the shape \(48, 64, 3\)", gemsplat.Scene,
                            [(camera(), np.zeros((64, 48, 3), np.uint8))])
        self.assert_refused("a pair: a Camera and its photo", gemsplat.Scene, [photo])


class Cameras(TestCase):
    def test_a_camera_keeps_what_it_is_given(self):
        pose = np.eye(4)
        pose[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
        pose[:3, 3] = [1, 2, 3]
        made = gemsplat.Camera(40, 30, 50, fy=51, cx=19, cy=16, cam_from_world=pose, name="a")
        self.assertEqual((made.width, made.height, made.fx, made.fy, made.cx, made.cy, made.name),
                         (40, 30, 50, 51, 19, 16, "a"))
        np.testing.assert_array_equal(made.cam_from_world, pose)
        np.testing.assert_allclose(made.position, -pose[:3, :3].T @ pose[:3, 3])
        half = made.at_resolution(2)
        self.assertEqual((half.width, half.height, half.fx, half.cy), (20, 15, 25, 8))

    def test_a_camera_has_a_time(self):
        made = gemsplat.Camera(40, 30, 50, name="a", time=0.25)
        self.assertEqual((made.time, made.at_resolution(2).time, gemsplat.Camera(40, 30, 50).time), (0.25, 0.25, 0))
        later = made.at_time(1)
        self.assertEqual((later.time, later.name, later.fx, made.time), (1, "a", 50, 0.25))
        self.assert_refused("time must lie between 0 and 1, but is 2", made.at_time, 2)
        self.assert_refused("time must lie between 0 and 1", gemsplat.Camera, 40, 30, 50, time=float("nan"))

    def test_what_is_no_camera_is_refused(self):
        refuse = lambda pattern, *arguments, **keywords: self.assert_refused(
            pattern, gemsplat.Camera, *arguments, **keywords)
        refuse("width and height must lie between 1 and", 0, 30, 50)
        refuse("fx and fy must be above 0", 40, 30, 0)
        refuse("3 or 4 rows and 4 columns", 40, 30, 50, cam_from_world=np.eye(3))
        moved = np.eye(4)
        moved[:3, 3] = 1, 2, 5
        refuse("is it transposed", 40, 30, 50, cam_from_world=moved.T)
        refuse("do not fit 32 bits", 40, 30, 1e-50)
        refuse("do not fit 32 bits", 40, 30, 50, cx=1e300)
        refuse("must hold a rotation", 40, 30, 50, cam_from_world=2 * np.eye(4)[:3])
        refuse("must hold a rotation", 40, 30, 50, cam_from_world=np.diag([1, 1, -1, 1]))
        refuse("must hold a rotation", 40, 30, 50, cam_from_world=np.full((3, 4), np.nan))


if __name__ == "__main__":
    unittest.main()
