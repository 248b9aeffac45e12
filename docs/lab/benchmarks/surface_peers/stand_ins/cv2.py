# SPDX-License-Identifier: Apache-2.0
"""The peers draw debug pictures with it, and nothing else."""
import numpy as np

COLORMAP_JET, INTER_LINEAR = 2, 1


def applyColorMap(gray, _):
    return np.repeat(np.asarray(gray)[..., None], 3, axis=-1)


def imwrite(path, picture, *_):
    return True
