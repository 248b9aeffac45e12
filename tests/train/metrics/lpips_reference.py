#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""LPIPS by NumPy in double, from its definition: prints the figures that lpips_test.cpp expects.

The networks are those of tests/support/lpips_file.h (patterned_network), the pictures those of the
test. usage: lpips_reference.py"""
import json
import math
import struct

import numpy as np

SLICES = {'alex': [[0], [3], [6], [8], [10]],
          'vgg': [[0, 2], [5, 7], [10, 12, 14], [17, 19, 21], [24, 26, 28]]}
KERNELS = {'alex': [11, 5, 3, 3, 3], 'vgg': [3] * 5}
POOLS = {'alex': [0, 3, 3, 0, 0], 'vgg': [0, 2, 2, 2, 2]}


def shapes(network, channels):
    result = {'scaling_layer.shift': (1, 3, 1, 1), 'scaling_layer.scale': (1, 3, 1, 1)}
    inputs = 3
    for stage, layers in enumerate(SLICES[network]):
        for layer in layers:
            name, kernel = f'net.slice{stage + 1}.{layer}', KERNELS[network][stage]
            result[name + '.weight'] = (channels[stage], inputs, kernel, kernel)
            result[name + '.bias'] = (channels[stage],)
            inputs = channels[stage]
        result[f'lin{stage}.model.1.weight'] = (1, channels[stage], 1, 1)
    return result


def weights(network, channels):
    result = {}
    for number, (name, shape) in enumerate(sorted(shapes(network, channels).items())):
        count = math.prod(shape)
        u = (7919 * np.arange(count) + 104729 * number + 13) % 1009 / 1009
        values = 4 * (u - 0.5) / math.sqrt(count / shape[0])
        if name.endswith('shift'):
            values = 0.3 * (u - 0.5)
        elif name.endswith('scale'):
            values = 0.5 + 0.2 * u
        elif name.startswith('lin'):
            values = u
        elif name.endswith('bias'):
            values = 0.2 * (u - 0.5)
        result[name] = values.astype(np.float32).astype(np.float64).reshape(shape)
    return result


def picture(height, width, seed):
    y, x, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(3), indexing='ij')
    values = (37 * x + 91 * y + 53 * c + 17 * seed + (3 + seed) * x * y) % 256 / 255
    return values.astype(np.float32).astype(np.float64)


def convolve(maps, kernels, bias, stride, padding):
    maps = np.pad(maps, ((0, 0), (padding, padding), (padding, padding)))
    windows = np.lib.stride_tricks.sliding_window_view(maps, kernels.shape[2:], (1, 2))
    result = np.einsum('cyxvu,ocvu->oyx', windows[:, ::stride, ::stride], kernels)
    return np.maximum(result + bias[:, None, None], 0)


def pooled(maps, edge):
    windows = np.lib.stride_tricks.sliding_window_view(maps, (edge, edge), (1, 2))
    return windows[:, ::2, ::2].max((3, 4))


def features(network, w, image):
    maps = 2 * image.transpose(2, 0, 1) - 1
    maps = (maps - w['scaling_layer.shift'][0]) / w['scaling_layer.scale'][0]
    for stage, layers in enumerate(SLICES[network]):
        if POOLS[network][stage]:
            maps = pooled(maps, POOLS[network][stage])
        for layer in layers:
            name = f'net.slice{stage + 1}.{layer}'
            is_first = network == 'alex' and stage == 0
            kernels = w[name + '.weight']
            stride, padding = (4, 2) if is_first else (1, kernels.shape[2] // 2)
            maps = convolve(maps, kernels, w[name + '.bias'], stride, padding)
        yield maps


def lpips(network, w, a, b):
    total = 0
    for stage, (f, g) in enumerate(zip(features(network, w, a), features(network, w, b))):
        f = f / (np.sqrt((f * f).sum(0)) + 1e-10)
        g = g / (np.sqrt((g * g).sum(0)) + 1e-10)
        importance = w[f'lin{stage}.model.1.weight'][0]
        total += (importance * (f - g) ** 2).sum(0).mean()
    return total


def write(path, arrays):
    """Writes a safetensors file of float32."""
    header, data = {}, b''
    for name, array in arrays.items():
        part = array.astype('<f4').tobytes()
        header[name] = {'dtype': 'F32', 'shape': array.shape, 'data_offsets': [len(data), len(data) + len(part)]}
        data += part
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack('<Q', len(text)) + text + data)


def main():
    for network, channels in (('alex', [4, 6, 5, 3, 4]), ('vgg', [4, 3, 5, 6, 4])):
        for height, width in ((33, 47), (70, 52)):
            a, b = picture(height, width, 1), picture(height, width, 2)
            figure = lpips(network, weights(network, channels), a, b)
            print(f'{{"{network}", {width}, {height}, {figure:.12f}}},')


if __name__ == '__main__':
    main()
