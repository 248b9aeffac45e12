# SPDX-License-Identifier: Apache-2.0
"""What tests of rasterize() draw in every framework, and what the exact renderer finds in float64."""

import numpy as np

import gemsplat

WIDTH, HEIGHT = 70, 45  # several tiles, the last ones cut off
VIEW = [[1, 0, 0, 0.1], [0, 1, 0, -0.2], [0, 0, 1, 3], [0, 0, 0, 1]]
K = [[60, 0, 33.3], [0, 65, 24.1], [0, 0, 1]]
PICTURES = ("image", "alpha", "depth", "inverse_depth", "features")

# Changes of arrays_for(100): every way to say what is drawn.
FORMS = {
    "as models are stored": {},
    "activated": {"log_scales": None, "logit_opacities": None, "scales": np.linspace(0.03, 0.3, 300).reshape(100, 3),
                  "opacities": np.linspace(0.01, 1, 100)[:, None]},
    "covariances": {"rotations": None, "log_scales": None,
                    "covariances": np.tile([0.02, 0.004, -0.003, 0.05, 0.002, 0.03], (100, 1))},
    "colors": {"sh": None, "colors": np.linspace(-0.2, 1, 300).reshape(100, 3)},
    "features": {"sh": None, "colors": np.linspace(0, 1, 300).reshape(100, 3),
                 "features": np.linspace(-1, 1, 500).reshape(100, 5)},
    "many features": {"features": np.linspace(-1, 1, 4400).reshape(100, 44)[::-1].copy()},
    "sh0 and sh_rest": {"sh": None, "sh0": np.linspace(-1, 1, 300).reshape(100, 3),
                        "sh_rest": np.linspace(-1, 1, 2400).reshape(100, 8, 3) / 4},
    "several views": {"viewmats": np.array([VIEW, VIEW]),
                      "Ks": np.array([K, [[90, 0, 30], [0, 80, 20], [0, 0, 1]]]),
                      "background": np.array([[0, 0.5, 1], [0.3, 0.2, 0.1]]), "screen": np.zeros((2, 100, 2)),
                      "colors": np.linspace(0, 1, 600).reshape(2, 100, 3), "sh": None},
}
SETTINGS = ({}, {"blend_rule": "classic"}, {"antialiased": True}, {"blur": 0.5, "near": 2.8},
            {"outputs": ("image", "alpha", "depth")}, {"outputs": ("inverse_depth",)}, {"deterministic": True})
# Not of JAX. With another near plane the gradient by the background is not nearly 0, which float32 could not tell.
LENSES = ({"camera_model": "fisheye"}, {"camera_model": "ortho", "near": 2.5, "outputs": ("image", "alpha", "depth")})


def arrays_for(count, seed=1, **others):
    """Arrays of float32 that rasterize() takes, for Gaussians in front of the camera; equal for a seed."""
    random = np.random.default_rng(seed)
    arrays = {"means": random.uniform(-1, 1, (count, 3)), "rotations": random.normal(size=(count, 4)),
              "log_scales": random.uniform(-3, -1, (count, 3)), "logit_opacities": random.uniform(-2, 4, count),
              "sh": random.normal(size=(count, 16, 3)) / 3, "viewmats": np.array(VIEW),
              "Ks": np.array(K), "background": random.uniform(0, 1, 3),
              "screen": random.uniform(-1, 1, (count, 2)), **others}
    return {name: array.astype(np.float32) for name, array in arrays.items() if array is not None}


def weights_of(shape):
    """dL by a picture: L depends on every pixel in a way of its own."""
    return np.sin(np.arange(np.prod(shape, dtype=int), dtype=np.float64)).reshape(shape)


def weights_of_pictures(rendering):
    drawn = {name: getattr(rendering, name) for name in PICTURES}
    return {name: weights_of(picture.shape) for name, picture in drawn.items() if picture is not None}


def draw(arrays, outputs=("image", "alpha"), width=WIDTH, height=HEIGHT, **settings):
    return gemsplat.rasterize(**arrays, width=width, height=height, outputs=outputs, **settings)


def exact(arrays, outputs=("image", "alpha"), **settings):
    """The Rendering in float64, and the gradients of L by every array."""
    arrays = {name: np.asarray(array, np.float64) for name, array in arrays.items()}
    rendering, pull = gemsplat.vjp(**arrays, width=WIDTH, height=HEIGHT, outputs=outputs, **settings)
    return rendering, pull(**weights_of_pictures(rendering))


def assert_near(test, array, expected, tolerance, name):
    """Relative to the norm of what is expected."""
    array, expected = np.asarray(array, np.float64), np.asarray(expected, np.float64)
    test.assertEqual(array.shape, expected.shape, name)
    difference = np.linalg.norm(array - expected)
    test.assertLessEqual(difference, tolerance * max(1e-6, np.linalg.norm(expected)), name)


def assert_as_exact(test, arrays, rendering, gradients, outputs=("image", "alpha"), **settings):
    """Pictures and gradients, which are NumPy arrays, are those of the exact renderer."""
    expected, by_exact = exact(arrays, outputs, **settings)
    for name, picture in expected._asdict().items():
        if picture is not None:
            assert_near(test, getattr(rendering, name), picture, 1e-5, name)
    test.assertEqual(set(gradients), set(by_exact))
    for name, gradient in by_exact.items():
        assert_near(test, gradients[name], gradient, 3e-4, f"the gradient by {name}")
