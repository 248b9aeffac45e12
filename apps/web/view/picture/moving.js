// SPDX-License-Identifier: Apache-2.0
// Gaussians that move, for Spark: one mesh for each chunk of a .gs4d file. While Spark gathers the
// Gaussians of a frame, its shader takes each one to its place at the time of the frame.
import {dyno, ExtSplats, SplatMesh, utils} from '@sparkjsdev/spark';
import {
  DataArrayTexture,
  Object3D,
  RedIntegerFormat,
  RGBAIntegerFormat,
  UnsignedIntType,
  Vector3,
} from 'three';
import {MIN_MARGINAL} from './gs4d.js';

const SH0 = 0.28209479177387814; // kSh0 of gs_core/math/constants.h
const MIN_ALPHA = 1 / 255; // kMinAlpha
const MOST_SH_EXPONENT = 31; // of Spark's packed SH
const LEAST_PICKED = 0.2; // opacity of a Gaussian that a click finds

const texture = (words, {width, height, depth}, format, internalFormat) => {
  const result = new DataArrayTexture(words, width, height, depth);
  Object.assign(result, {format, type: UnsignedIntType, internalFormat, needsUpdate: true});
  return result;
};

// The chunk's Gaussians in Spark's form of 32 bytes, with their motion in two textures more.
class MovingSplats extends ExtSplats {
  constructor(chunk, time) {
    const {count} = chunk,
      size = utils.getTextureSize(count),
      {maxSplats} = size;
    const extArrays = [new Uint32Array(4 * maxSplats), new Uint32Array(4 * maxSplats)];
    const path = new Float32Array(4 * maxSplats),
      falloff = new Float32Array(maxSplats);
    const {mean, velocity, logScale, sh0, rotation: q, opacity} = chunk;
    for (let i = 0; i < count; ++i) {
      const n = 3 * i;
      utils.encodeExtSplat(
        extArrays,
        i,
        mean[n],
        mean[n + 1],
        mean[n + 2],
        ...[0, 1, 2].map(k => Math.exp(logScale[n + k])),
        q[4 * i],
        q[4 * i + 1],
        q[4 * i + 2],
        q[4 * i + 3],
        opacity[i],
        ...[0, 1, 2].map(k => 0.5 + SH0 * sh0[n + k]),
      );
      path.set([velocity[n], velocity[n + 1], velocity[n + 2], chunk.timeMean[i]], 4 * i);
      falloff[i] = -0.5 / chunk.timeScale[i] ** 2;
    }
    super({extArrays, numSplats: count, extra: packedSh(chunk, maxSplats)});
    this.chunk = chunk;
    this.motion = {
      path: new dyno.DynoUsampler2DArray({
        key: 'path',
        value: texture(new Uint32Array(path.buffer), size, RGBAIntegerFormat, 'RGBA32UI'),
      }),
      falloff: new dyno.DynoUsampler2DArray({
        key: 'falloff',
        value: texture(new Uint32Array(falloff.buffer), size, RedIntegerFormat, 'R32UI'),
      }),
      time,
    };
  }

  fetchSplat({index, viewOrigin}) {
    const moved = dyno.dyno({
      inTypes: {index: 'int', path: 'usampler2DArray', falloff: 'usampler2DArray', time: 'float'},
      outTypes: {shift: 'vec3', factor: 'float'},
      inputs: {index, ...this.motion},
      statements: ({inputs, outputs}) => [
        `ivec3 place = splatTexCoord(${inputs.index});`,
        `vec4 way = uintBitsToFloat(texelFetch(${inputs.path}, place, 0));`,
        `float elapsed = ${inputs.time} - way.w;`,
        `${outputs.shift} = way.xyz * elapsed;`,
        `${outputs.factor} = exp(uintBitsToFloat(texelFetch(${inputs.falloff}, place, 0).x) * elapsed * elapsed);`,
      ],
    }).outputs;
    // Colors are those of the moved Gaussian: the eye is moved the other way.
    const gsplat = super.fetchSplat({
      index,
      viewOrigin: viewOrigin && dyno.sub(viewOrigin, moved.shift),
    });
    return dyno.dyno({
      inTypes: {gsplat: dyno.Gsplat, shift: 'vec3', factor: 'float'},
      outTypes: {gsplat: dyno.Gsplat},
      inputs: {gsplat, shift: moved.shift, factor: moved.factor},
      globals: () => [dyno.defineGsplat],
      statements: ({inputs, outputs}) => [
        `${outputs.gsplat} = ${inputs.gsplat};`,
        `${outputs.gsplat}.center += ${inputs.shift};`,
        `${outputs.gsplat}.rgba.a *= ${inputs.factor};`,
        `if (${inputs.factor} < ${MIN_MARGINAL} || ${outputs.gsplat}.rgba.a < ${MIN_ALPHA}) ${outputs.gsplat}.flags = 0u;`,
      ],
    }).outputs.gsplat;
  }

  dispose() {
    super.dispose();
    this.motion?.path.value.dispose();
    this.motion?.falloff.value.dispose();
  }
}

// Three numbers with a common exponent: 8 bits each, the exponent, and the signs.
function packedColor(r, g, b) {
  const largest = Math.max(Math.abs(r), Math.abs(g), Math.abs(b));
  const exponent =
    largest > 0 ? Math.max(0, Math.min(MOST_SH_EXPONENT, Math.ceil(Math.log2(largest)) + 15)) : 0;
  const unit = 2 ** (exponent - 15) / 255,
    byte = x => Math.min(255, Math.round(Math.abs(x) / unit));
  const signs = (r < 0 ? 1 : 0) | (g < 0 ? 2 : 0) | (b < 0 ? 4 : 0);
  return (byte(r) | (byte(g) << 8) | (byte(b) << 16) | (((exponent << 3) | signs) << 24)) >>> 0;
}

// The SH beyond degree 0, where Spark looks for each coefficient: [array, word of its four].
function packedSh({count, shDegree, sh}, maxSplats) {
  const extra = {},
    coefficients = (shDegree + 1) ** 2 - 1;
  const place = c =>
    c < 4 ? ['sh1', c] : c < 8 ? ['sh2', c - 4] : c < 12 ? ['sh3a', c - 8] : ['sh3b', c - 12];
  for (let c = 0; c < coefficients; ++c) {
    const [name, word] = place(c),
      words = (extra[name] ??= new Uint32Array(4 * maxSplats));
    for (let i = 0; i < count; ++i) {
      const n = 3 * (i * coefficients + c);
      words[4 * i + word] = packedColor(sh[n], sh[n + 1], sh[n + 2]);
    }
  }
  return extra;
}

/// A model that moves, as chunks of it arrive. It has the parts of a SplatMesh that SplatPicture
/// uses.
export class MovingModel extends Object3D {
  constructor() {
    super();
    this.clock = new dyno.DynoFloat({key: 'moment', value: 0});
  }

  add(chunk) {
    const mesh = new SplatMesh({extSplats: new MovingSplats(chunk, this.clock)});
    if (this.degree !== undefined) mesh.maxSh = this.degree;
    super.add(mesh);
    this.showChunk(mesh);
  }

  // A chunk of which nothing is drawn at this time is left out.
  showChunk(mesh) {
    const {begin, end} = mesh.extSplats.chunk;
    mesh.visible = begin <= this.time && this.time <= end;
    // With it Spark goes on showing the last sorted time until this one is sorted, too.
    mesh.updateMappingVersion();
  }

  get time() {
    return this.clock.value;
  }
  set time(value) {
    this.clock.value = value;
    this.children.forEach(mesh => this.showChunk(mesh));
  }

  get numSplats() {
    return this.children.reduce((sum, mesh) => sum + mesh.numSplats, 0);
  }
  set maxSh(degree) {
    this.degree = degree;
    for (const mesh of this.children) mesh.maxSh = degree;
  }
  updateGenerator() {
    this.children.forEach(mesh => mesh.updateGenerator());
  }
  dispose() {
    this.children.forEach(mesh => mesh.dispose());
  }

  // The Gaussians of this time that a ray passes within one standard deviation.
  raycast({ray}, hits) {
    const center = new Vector3(),
      {x, y, z} = ray.direction;
    for (const {visible, extSplats} of this.children) {
      if (!visible) continue;
      const {count, mean, velocity, logScale, timeMean, timeScale, opacity} = extSplats.chunk;
      for (let i = 0; i < count; ++i) {
        const elapsed = this.time - timeMean[i];
        if (opacity[i] * Math.exp(-0.5 * (elapsed / timeScale[i]) ** 2) < LEAST_PICKED) continue;
        center
          .set(...[0, 1, 2].map(k => mean[3 * i + k] + velocity[3 * i + k] * elapsed))
          .sub(ray.origin);
        const distance = center.x * x + center.y * y + center.z * z;
        const radius = Math.exp((logScale[3 * i] + logScale[3 * i + 1] + logScale[3 * i + 2]) / 3);
        if (distance > 0 && center.lengthSq() - distance ** 2 < radius ** 2)
          hits.push({distance, point: ray.at(distance, new Vector3()), object: this});
      }
    }
  }
}
